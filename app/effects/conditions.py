"""What the machine went through at the times that matter: temperatures, states, and their past.

The same class serves the n rows of a search, the n rows of a prediction, and the one
moment of a live table: what drives an effect is asked of it and of nothing else.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, Literal, NamedTuple, Protocol, TypeVar, overload

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray
from app.effects.low_pass import (
    RESTED_S,
    SETTLED,
    UNREAD,
    Filtered,
    FromStart,
    LagState,
    beginnings,
    last_state,
    low_pass,
)
from app.effects.play import play, play_at
from app.errors import list_names
from app.thermal.machine import Sensor
from app.thermal.temperature_history import TemperatureHistory, between_readings
from app.units import SECONDS_PER_H, SECONDS_PER_MIN

RATE_OVER_S: Final = 600.0
"""Time over which a rate of temperature is taken [s]."""

STATE_GAP_S: Final = 600.0
"""A state counts for so long after its reading where no sensor says otherwise [s]."""

ABOUT_S: Final = 60.0 * np.arange(-5.0, 6.0)
"""Times about which a sensor is read where it is asked what it read at another time [s].

How late a sensor is, is found by moving its readings. If single ones are moved, their noise moves
too: the likelihood of being late by 28, 28.5 or 29 min then differs by what a reading is off, each
dip of it looks like the best, and its width like the standard error.
"""


def _parabolas() -> FloatArray:
    """Weigh what is read about a time so that a parabola has its own value there.

    A. Savitzky, M. Golay, Anal. Chem. 36 (1964) 1627. A row for each reach, shape (1 + m, 1 + 2 m):
    none, and 1 to m times to either side.
    """
    at = np.arange(len(ABOUT_S)) - len(ABOUT_S) // 2
    parabolas = np.zeros((len(ABOUT_S) // 2 + 1, len(ABOUT_S)))
    for reach, weights in enumerate(parabolas):
        near = np.abs(at) <= reach
        powers = np.vander(at[near], min(3, 2 * reach + 1), increasing=True)
        weights[near] = np.linalg.pinv(powers)[0]
    return parabolas


PARABOLA: Final = _parabolas()
"""Weights of what is read at `ABOUT_S`, by how far it is known to both sides."""

Key = TypeVar("Key", bound=Hashable)
"""What names a signal."""

MOST_FILTERS: Final = 256
"""Filtered records that are kept ready, and as many with play."""


class Signal(NamedTuple):
    """Something that is recorded: a sensor's temperature, or a power of a state.

    The power 0 stands for whether a state is other than 0: 1 or 0.
    """

    kind: Literal["temperature", "state"]
    name: str
    power: int = 1

    @overload
    def of(self, reading: float) -> float: ...

    @overload
    def of(self, reading: FloatArray) -> FloatArray: ...

    def of(self, reading: float | FloatArray) -> float | FloatArray:
        """Make the signal of a reading, or of many.

        >>> Signal("state", "spindle_rpm", 0).of(2000.0)
        1.0
        """
        return reading**self.power if self.power else (reading != 0.0) * 1.0


class Drives(Protocol):
    """Something that changes with the conditions."""

    def at(self, conditions: Conditions) -> FloatArray:
        """Give its value at n moments, shape (n,)."""


class Lags:
    """Who knows the past; by itself nobody, as in a request with present temperatures only."""

    def lagged(self, signal: Signal, time_constant_s: float, times_s: FloatArray) -> FloatArray:
        """Give a signal's low-pass at times, NaN where its past is not known."""
        return np.full(times_s.shape, np.nan)

    def from_start(self, signal: Signal, time_constant_s: float, times_s: FloatArray) -> FromStart:
        """Give the same from the beginning of the unbroken record, in balance there."""
        return FromStart.unknown(len(times_s))

    def unread(self, signal: Signal, time_constant_s: float, times_s: FloatArray) -> FloatArray:
        """Say which share of a signal's low-pass rests on gaps, NaN where it has no record."""
        return np.full(times_s.shape, np.nan)

    def played(self, signal: Signal, half_width: float, times_s: FloatArray) -> FloatArray:
        """Give what follows a signal with play, NaN where its past is not known."""
        return np.full(times_s.shape, np.nan)

    def at(self, signal: Signal, times_s: FloatArray) -> FloatArray:
        """Give a signal at any times, later ones too, NaN where it is not known."""
        return np.full(times_s.shape, np.nan)

    def why_missing(self, signal: Signal, time_constant_s: float, times_s: FloatArray) -> str:
        """Say in a sentence's second half what is missing."""
        return f"the history of {signal.name} is not known here"

    def record_before_s(self, signal: Signal, time_s: float) -> float:
        """Say for how long before a time a signal was recorded [s]."""
        return 0.0


@dataclass(frozen=True, eq=False)
class Recording:
    """One signal's known readings, in order of time.

    Parameters
    ----------
    times_s : ndarray, shape (n,) [s]
        Strictly increasing.
    values : ndarray, shape (n,)
        Readings, none of them NaN.
    max_gap_s
        Longest gap over which the readings are known [s].
    begins_s : ndarray, shape (m,) [s]
        When the machine began to be read after a rest: the same for all of its signals.
    """

    times_s: FloatArray
    values: FloatArray
    max_gap_s: float
    begins_s: FloatArray

    def filtered(self, signal: Signal, time_constant_s: float) -> Filtered:
        """Filter the whole record."""
        return low_pass(*self._filter(signal, time_constant_s))

    def last_state(self, signal: Signal, time_constant_s: float) -> LagState:
        """Filter the whole record, and keep the filter after its last reading."""
        return last_state(*self._filter(signal, time_constant_s))

    def _filter(
        self, signal: Signal, time_constant_s: float
    ) -> tuple[FloatArray, FloatArray, float, float, FloatArray]:
        inputs = signal.of(self.values)
        return self.times_s, inputs, time_constant_s, self.max_gap_s, self.begins_s

    def at(self, times_s: FloatArray) -> FloatArray:
        """Give the value at times, the last reading's until it is too old, else NaN."""
        if self.times_s.size == 0:
            return np.full(times_s.shape, np.nan)
        at = np.searchsorted(self.times_s, times_s, side="right") - 1
        before = np.maximum(at, 0)
        near = (at >= 0) & (times_s - self.times_s[before] <= self.max_gap_s)
        return np.where(near, self.values[before], np.nan)


@dataclass(frozen=True, eq=False)
class RecordedLags(Lags):
    """The past as the readings tell it."""

    recordings: Mapping[tuple[str, str], Recording]
    _filtered: dict[tuple[Signal, float], Filtered] = field(default_factory=dict)
    _played: dict[tuple[Signal, float], FloatArray] = field(default_factory=dict)

    def lagged(self, signal: Signal, time_constant_s: float, times_s: FloatArray) -> FloatArray:
        """Give a signal's low-pass at times (`Filtered.at`)."""
        filtered = self._filter(signal, time_constant_s)
        return (
            super().lagged(signal, time_constant_s, times_s)
            if filtered is None
            else filtered.at(times_s)
        )

    def from_start(self, signal: Signal, time_constant_s: float, times_s: FloatArray) -> FromStart:
        """Give a signal's low-pass from the beginning of its record (`Filtered.from_start`)."""
        filtered = self._filter(signal, time_constant_s)
        return FromStart.unknown(len(times_s)) if filtered is None else filtered.from_start(times_s)

    def unread(self, signal: Signal, time_constant_s: float, times_s: FloatArray) -> FloatArray:
        """Say which share of a signal's low-pass rests on gaps (`Filtered.unread_at`)."""
        filtered = self._filter(signal, time_constant_s)
        if filtered is None:
            return super().unread(signal, time_constant_s, times_s)
        return filtered.unread_at(times_s)

    def played(self, signal: Signal, half_width: float, times_s: FloatArray) -> FloatArray:
        """Give what follows a signal with play (`play_at`)."""
        recording = self._recording(signal)
        if recording is None:
            return super().played(signal, half_width, times_s)
        key = (signal, half_width)
        if key not in self._played:
            if len(self._played) >= MOST_FILTERS:
                self._played.pop(next(iter(self._played)))
            self._played[key] = play(
                recording.times_s, signal.of(recording.values), half_width, recording.max_gap_s
            )
        now = self.at(signal, times_s)
        return play_at(recording.times_s, self._played[key], half_width, times_s, now)

    def at(self, signal: Signal, times_s: FloatArray) -> FloatArray:
        """Give a signal at any times: temperatures interpolated, states as they were last read."""
        recording = self._recording(signal)
        if recording is None:
            return super().at(signal, times_s)
        if signal.kind == "state":
            return signal.of(recording.at(times_s))
        return between_readings(recording.times_s, recording.values, times_s, recording.max_gap_s)

    def why_missing(self, signal: Signal, time_constant_s: float, times_s: FloatArray) -> str:
        """Say how much history is needed, and how much there is."""
        have = self.record_before_s(signal, float(times_s.min()))
        need_min = SETTLED * time_constant_s / SECONDS_PER_MIN
        if have < SETTLED * time_constant_s:
            return (
                f"expected {need_min:.0f} min of readings of {signal.name} beforehand (five time "
                f"constants), got {have / SECONDS_PER_MIN:.0f} min"
            )
        return f"the readings of {signal.name} have gaps in the preceding {need_min:.0f} min"

    def record_before_s(self, signal: Signal, time_s: float) -> float:
        """Say for how long before a time a signal was recorded [s]."""
        recording = self._recording(signal)
        return 0.0 if recording is None else max(time_s - float(recording.times_s[0]), 0.0)

    def _recording(self, signal: Signal) -> Recording | None:
        recording = self.recordings.get((signal.kind, signal.name))
        return None if recording is None or recording.times_s.size == 0 else recording

    def _filter(self, signal: Signal, tau_s: float) -> Filtered | None:
        key, recording = (signal, tau_s), self._recording(signal)
        if recording is None:
            return None
        if key not in self._filtered:
            if len(self._filtered) >= MOST_FILTERS:
                self._filtered.pop(next(iter(self._filtered)))
            self._filtered[key] = recording.filtered(signal, tau_s)
        return self._filtered[key]


@dataclass(frozen=True, eq=False)
class SomeRows(Mapping[Key, FloatArray]):
    """Some rows of every signal, picked out when they are asked for.

    Each of some eighty components looks at other rows: copies of all signals for each of them
    would be most of what a large campaign takes.
    """

    signals: Mapping[Key, FloatArray]
    rows: IntArray

    def __getitem__(self, name: Key) -> FloatArray:
        return self.signals[name][self.rows]

    def __iter__(self) -> Iterator[Key]:
        return iter(self.signals)

    def __len__(self) -> int:
        return len(self.signals)


@dataclass(frozen=True, eq=False)
class StatedStates(Mapping[str, FloatArray]):
    """What is stated of the machine's state beside n rows, as arrays of n when they are asked for.

    Each row may state other names: all names for all rows at once could fill the memory.
    """

    stated: Sequence[Mapping[str, float]]

    def __getitem__(self, name: str) -> FloatArray:
        if name not in self._names:
            raise KeyError(name)
        return np.array([state.get(name, np.nan) for state in self.stated], dtype=float)

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    @cached_property
    def _names(self) -> dict[str, None]:
        return dict.fromkeys(sorted({name for state in self.stated for name in state}))


@dataclass(frozen=True, eq=False)
class RecordedStates(Mapping[str, FloatArray]):
    """States at n times, read off the record when they are asked for, and then kept.

    Parameters
    ----------
    beside
        What was stated beside the times goes before the record.
    """

    recordings: Mapping[tuple[str, str], Recording]
    times_s: FloatArray
    beside: Mapping[str, FloatArray]
    _read: dict[str, FloatArray] = field(default_factory=dict, init=False)

    def __getitem__(self, name: str) -> FloatArray:
        if name not in self._read:
            self._read[name] = self._at_times(name)
        return self._read[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __contains__(self, name: object) -> bool:
        return name in self._names

    @cached_property
    def _names(self) -> dict[str, None]:
        recorded = [name for kind, name in self.recordings if kind == "state"]
        return dict.fromkeys([*recorded, *self.beside])

    def _at_times(self, name: str) -> FloatArray:
        recording = self.recordings.get(("state", name))
        if recording is None:
            return self.beside[name]
        recorded, beside = recording.at(self.times_s), self.beside.get(name)
        return recorded if beside is None else np.where(np.isnan(beside), recorded, beside)


@dataclass(frozen=True, eq=False)
class Conditions:
    """Temperatures, states and their past at n times.

    Parameters
    ----------
    times_s : ndarray, shape (n,) [s]
        Seconds since 1970-01-01 UTC.
    temperatures_c : mapping of sensor to ndarray, shape (n,) [°C]
        NaN where there is no usable reading.
    states : mapping of name to ndarray, shape (n,)
        The machine's state, NaN where it is not known.
    rates_c_per_h : mapping of sensor to ndarray, shape (n,) [°C/h]
        How fast temperatures change, where that was asked.
    late : mapping of signal and time constant [s] to ndarray, shape (n,)
        Low-passes that are known already; others are made where they are asked for.
    """

    times_s: FloatArray
    temperatures_c: Mapping[str, FloatArray]
    states: Mapping[str, FloatArray] = field(default_factory=dict)
    lags: Lags = field(default_factory=Lags)
    rates_c_per_h: Mapping[str, FloatArray] = field(default_factory=dict)
    late: Mapping[tuple[Signal, float], FloatArray] = field(default_factory=dict)
    _driven: tuple[Drives, FloatArray] | None = field(default=None, init=False)

    def __len__(self) -> int:
        return len(self.times_s)

    @classmethod
    def of_moment(
        cls,
        time_s: float,
        temperatures_c: Mapping[str, float],
        states: Mapping[str, float] | None = None,
        lags: Lags | None = None,
    ) -> Conditions:
        """Make the conditions of one live moment.

        Parameters
        ----------
        temperatures_c
            Usable temperatures [°C].
        lags
            Who knows the past; without it, effects that need it are missing.
        """
        return cls(
            np.array([time_s]),
            {name: np.array([value]) for name, value in temperatures_c.items()},
            {name: np.array([value]) for name, value in (states or {}).items()},
            lags or Lags(),
        )

    def temperature(self, sensor: str) -> FloatArray:
        """Give a sensor's temperatures, shape (n,) [°C], NaN where there is none."""
        values = self.temperatures_c.get(sensor)
        return np.full(len(self), np.nan) if values is None else values

    def state(self, name: str) -> FloatArray:
        """Give a state, shape (n,), NaN where it is not known."""
        values = self.states.get(name)
        return np.full(len(self), np.nan) if values is None else values

    def lagged(self, signal: Signal, time_constant_s: float) -> FloatArray:
        """Give a signal's low-pass, shape (n,), NaN without five time constants of history."""
        late = self.late.get((signal, time_constant_s))
        return self.lags.lagged(signal, time_constant_s, self.times_s) if late is None else late

    def driven(self, driver: Drives) -> FloatArray:
        """Give a driver, shape (n,); the last one is kept, as one shape asks after the other."""
        last = self._driven
        if last is None or last[0] is not driver:
            last = (driver, driver.at(self))
            object.__setattr__(self, "_driven", last)
        return last[1]

    def temperature_later(self, sensor: str, by_s: float | FloatArray) -> FloatArray:
        """Give what a sensor read some time later, or earlier, shape (n,) [°C], NaN: not known.

        The time may be another one for each row, shape (n,) [s].

        It is what a parabola through the readings within some minutes about then has in the middle,
        of as many before as after.
        """
        # Rows at one time share what is read, and times in order are found faster.
        wanted_s, place = np.unique(self.times_s + by_s, return_inverse=True)
        about_s = wanted_s[:, None] + ABOUT_S
        read = self.lags.at(Signal("temperature", sensor), about_s.ravel()).reshape(about_s.shape)
        is_known = np.isfinite(read)
        middle = len(ABOUT_S) // 2
        # By how many minutes it is known to both sides without a hole: 1 as long as it goes on,
        # then 0.
        both = is_known[:, middle + 1 :] & is_known[:, :middle][:, ::-1]
        reach = np.cumprod(both, axis=1).sum(axis=1)
        smoothed: FloatArray = np.sum(PARABOLA[reach] * np.where(is_known, read, 0.0), axis=1)
        return np.where(is_known[:, middle], smoothed, np.nan)[place]

    def is_known_later(self, sensor: str, by_s: float | FloatArray) -> BoolArray:
        """Say where it is known what a sensor read some time later, or earlier, shape (n,)."""
        read = self.lags.at(Signal("temperature", sensor), self.times_s + by_s)
        return np.isfinite(read)

    def from_start(self, signal: Signal, time_constant_s: float) -> FromStart:
        """Give a signal's low-pass from the beginning of its unbroken record, shape (n,) each."""
        return self.lags.from_start(signal, time_constant_s, self.times_s)

    def take(self, rows: IntArray) -> Conditions:
        """Keep some rows; the past is shared, and so are all values until they are asked for."""
        places: dict[int, IntArray] = {}

        def some(signals: Mapping[Key, FloatArray]) -> SomeRows[Key]:
            """Of rows that were picked out already, pick out of the same whole."""
            if not isinstance(signals, SomeRows):
                return SomeRows(signals, rows)
            key = id(signals.rows)
            if key not in places:
                places[key] = signals.rows[rows]
            return SomeRows(signals.signals, places[key])

        return Conditions(
            self.times_s[rows],
            some(self.temperatures_c),
            some(self.states),
            self.lags,
            some(self.rates_c_per_h),
            some(self.late),
        )

    def why_missing(self, signal: Signal, time_constant_s: float | None = None) -> str:
        """Say what is missing where a driver is NaN."""
        if time_constant_s is not None:
            return self.why_unread(signal, time_constant_s) or self.lags.why_missing(
                signal, time_constant_s, self.times_s
            )
        have = self.temperatures_c if signal.kind == "temperature" else self.states
        if signal.name in have:
            what = "usable reading of" if signal.kind == "temperature" else "reading states"
            return f"no {what} {signal.name} at that time"
        return f"no {signal.kind} {signal.name} (there are {list_names(have)})"

    def why_unread(self, signal: Signal, time_constant_s: float) -> str:
        """Say that too much of a low-pass rests on gaps, and for how long; empty where it does not.

        Where a record did not begin at rest, all from before it is such a gap.
        """
        unread = self.lags.unread(signal, time_constant_s, self.times_s)
        unread = unread[np.isfinite(unread)]
        if not (unread > UNREAD).any():
            return ""
        most = float(unread.max())
        lasts_min = time_constant_s * np.log(most / UNREAD) / SECONDS_PER_MIN
        return (
            f"readings of {signal.name} were missing, and {most:.0%} of what follows it with a "
            f"time constant of {time_constant_s / SECONDS_PER_MIN:.3g} min rests on that gap, "
            f"expected at most {UNREAD:.0%}: that takes {np.ceil(lasts_min):.0f} min without "
            "another one"
        )


def recorded_conditions(
    sensors: Mapping[str, Sensor],
    history: TemperatureHistory,
    state_readings: Sequence[tuple[float, Mapping[str, float]]],
    times_s: FloatArray,
    own_states: Mapping[str, FloatArray] | None = None,
) -> Conditions:
    """Read off a record what held at n times.

    Parameters
    ----------
    sensors
        Name to sensor: how long its readings serve.
    history
        Temperatures that can be believed (`app.thermal.sensor_health.believed`).
    state_readings
        Time [s] and the machine's state of each reading, in order of time.
    times_s : ndarray, shape (n,) [s]
    own_states : mapping of name to ndarray, shape (n,)
        States that were stated beside the times themselves and go before the readings',
        NaN where none was stated.
    """
    temperatures: dict[str, FloatArray] = {}
    rates: dict[str, FloatArray] = {}
    for name, sensor in sensors.items():
        if name in history.temperatures_c:
            temperatures[name] = history.at(name, times_s, sensor.max_age_s)
            earlier = history.at(name, times_s - RATE_OVER_S, sensor.max_age_s)
            rates[name] = (temperatures[name] - earlier) * (SECONDS_PER_H / RATE_OVER_S)
    recordings = recordings_of(sensors, history, state_readings)
    states = RecordedStates(recordings, times_s, own_states or {})
    return Conditions(times_s, temperatures, states, RecordedLags(recordings), rates)


def recordings_of(
    sensors: Mapping[str, Sensor],
    history: TemperatureHistory,
    state_readings: Sequence[tuple[float, Mapping[str, float]]],
) -> dict[tuple[str, str], Recording]:
    """Take a record apart into its signals."""
    begins_s = beginnings(times_read(history, state_readings), rested_s(sensors))
    recordings: dict[tuple[str, str], Recording] = {}
    for name, sensor in sensors.items():
        if name in history.temperatures_c:
            times, values = history.series(name)
            recordings["temperature", name] = Recording(times, values, sensor.max_age_s, begins_s)
    gap_s = state_gap_s(sensors)
    for name, readings in _state_readings(state_readings).items():
        times, values = np.array(readings, dtype=float).T
        recordings["state", name] = Recording(times, values, gap_s, begins_s)
    return recordings


def times_read(
    history: TemperatureHistory, state_readings: Sequence[tuple[float, Mapping[str, float]]]
) -> FloatArray:
    """List when anything of a machine was read, believed or not, in order of time [s]."""
    times_s: FloatArray = np.union1d(history.times_s, [time_s for time_s, _ in state_readings])
    return times_s


def rested_s(sensors: Mapping[str, Sensor]) -> float:
    """Say for how long a machine must not have been read to have rested [s].

    Longer than any of its sensors may go without a reading.
    """
    return max((RESTED_S, *(s.max_age_s for s in sensors.values())))


def state_gap_s(sensors: Mapping[str, Sensor]) -> float:
    """Say how long a state counts after its reading: as long as the most patient sensor [s]."""
    return max((s.max_age_s for s in sensors.values()), default=STATE_GAP_S)


def _state_readings(
    readings: Sequence[tuple[float, Mapping[str, float]]],
) -> dict[str, list[tuple[float, float]]]:
    """List the times [s] and values of each state."""
    by_state: dict[str, list[tuple[float, float]]] = {}
    for time_s, state in readings:
        for name, value in state.items():
            by_state.setdefault(name, []).append((time_s, value))
    return by_state
