"""What adopted effects need of the past, carried on from reading to reading.

Filters forget: after thirty time constants of readings it no longer shows how one began. So a
past that was rebuilt from that much of the record is the one that was carried along all the time.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from app.effects.adopted.live_lags import LiveLags
from app.effects.conditions import (
    Recording,
    Signal,
    recordings_of,
    rested_s,
    state_gap_s,
    times_read,
)
from app.effects.effect import Effect
from app.effects.low_pass import beginnings
from app.thermal.machine import Sensor
from app.thermal.temperature_history import TemperatureHistory

FORGOTTEN: Final = 30.0
"""Time constants after which a filter's beginning is lost in rounding: exp(−30) is 1e-13."""


@dataclass(frozen=True)
class Needed:
    """What effects need of the past.

    Parameters
    ----------
    lags
        Signals and the time constants [s] of their low-passes.
    """

    lags: frozenset[tuple[Signal, float]] = frozenset()
    states: frozenset[str] = frozenset()

    def __bool__(self) -> bool:
        return bool(self.lags or self.states)

    @property
    def record_s(self) -> float:
        """How far back the record must go [s]."""
        return FORGOTTEN * max((tau_s for _, tau_s in self.lags), default=0.0)

    @property
    def sensors(self) -> frozenset[str]:
        """The sensors that are filtered."""
        return frozenset(signal.name for signal, _ in self.lags if signal.kind == "temperature")


@dataclass(frozen=True, eq=False)
class Past:
    """Filters and states at the latest reading.

    Parameters
    ----------
    states
        Name to the time [s] and value that were last read, None before the first.
    state_gap_s
        How long a state counts [s].
    """

    lags: LiveLags
    states: Mapping[str, tuple[float, float] | None] = field(default_factory=dict)
    state_gap_s: float = 0.0

    @classmethod
    def unread(cls, sensors: Mapping[str, Sensor], needed: Needed) -> Past:
        """Begin before the first reading.

        Parameters
        ----------
        sensors
            Name to sensor: how long readings serve.
        """
        gap_s = state_gap_s(sensors)
        gaps_s: dict[tuple[str, str], float] = {
            (signal.kind, signal.name): (
                gap_s if signal.kind == "state" else _max_age_s(sensors, signal.name)
            )
            for signal, _ in needed.lags
        }
        lags = LiveLags(dict.fromkeys(needed.lags), gaps_s, rested_s(sensors))
        return cls(lags, dict.fromkeys(needed.states), gap_s)

    @classmethod
    def of_record(
        cls,
        sensors: Mapping[str, Sensor],
        needed: Needed,
        history: TemperatureHistory,
        state_readings: Sequence[tuple[float, Mapping[str, float]]],
    ) -> Past:
        """Rebuild what would have been carried along over a record.

        Parameters
        ----------
        sensors
            Name to sensor: how long readings serve.
        state_readings
            Time [s] and the machine's state of each reading, in order of time.
        """
        lags = cls.unread(sensors, needed).lags
        recordings = recordings_of(sensors, history, state_readings)
        read_s = times_read(history, state_readings)
        if read_s.size:
            begun_s = float(beginnings(read_s, lags.rested_s)[-1])
            lags = replace(lags, begun_s=begun_s, read_s=float(read_s[-1]))
        filters = {
            (signal, tau_s): recording.last_state(signal, tau_s)
            for signal, tau_s in needed.lags
            for recording in [recordings.get((signal.kind, signal.name))]
            if recording is not None and (recording.times_s[-1:] >= lags.begun_s).any()
        }
        lags = replace(lags, filters={**lags.filters, **filters})
        states = {name: _latest(recordings.get(("state", name))) for name in needed.states}
        return cls(lags, states, state_gap_s(sensors))

    def is_out_of_order(
        self, time_s: float, temperatures_c: Mapping[str, float], states: Mapping[str, float]
    ) -> bool:
        """Say whether a reading comes after a later one that is in here already."""
        read = {"temperature": temperatures_c, "state": states}
        filters = self.lags.filters.items()
        filtered = [f.time_s for (s, _), f in filters if f is not None and s.name in read[s.kind]]
        state_times = [
            latest[0] for name, latest in self.states.items() if latest and name in states
        ]
        # One from before the machine rested may show that it did not.
        return time_s < max([self.lags.begun_s, *filtered, *state_times])

    def update(
        self, time_s: float, temperatures_c: Mapping[str, float], states: Mapping[str, float]
    ) -> Past:
        """Take the next reading."""
        latest = {name: (time_s, value) for name, value in states.items() if name in self.states}
        return Past(
            self.lags.update(time_s, temperatures_c, states),
            {**self.states, **latest},
            self.state_gap_s,
        )

    def states_at(self, time_s: float) -> dict[str, float]:
        """Give the states that count at a time at or after the latest reading [s]."""
        return {
            name: value
            for name, latest in self.states.items()
            if latest is not None
            for at_s, value in [latest]
            if time_s - at_s <= self.state_gap_s
        }


def needed_past(effects: Iterable[Effect]) -> Needed:
    """Say what effects need of the past."""
    signals = [s for effect in effects for term in effect.terms for s in term.driver.signals]
    return Needed(
        frozenset((signal, tau_s) for signal, tau_s in signals if tau_s is not None),
        frozenset(signal.name for signal, _ in signals if signal.kind == "state"),
    )


def sensors_of(effects: Iterable[Effect]) -> set[str]:
    """Name all sensors without which effects cannot be evaluated."""
    sensors = {name for effect in effects for name in effect.sensors}
    signals = [s for effect in effects for term in effect.terms for s, _ in term.driver.signals]
    return sensors | {signal.name for signal in signals if signal.kind == "temperature"}


def _max_age_s(sensors: Mapping[str, Sensor], name: str) -> float:
    return sensors[name].max_age_s if name in sensors else 0.0


def _latest(recording: Recording | None) -> tuple[float, float] | None:
    if recording is None:
        return None
    return float(recording.times_s[-1]), float(recording.values[-1])
