"""Many sensors and states with lags as one driver, because collinear ones only tell together.

Each column is made from the machine's record since its beginning: a temperature, a state, or
whether that is on, each late by a time constant; the difference of a body from the others when the
record began, and how that dies out; and a late temperature times the level of all of them. Before
the record the machine is taken to have rested at the temperatures of its first reading, with all
states 0. Where nothing changes at first, the record begins when something does.

Beside maps that one sensor leads through, a column can also be how far another late temperature is
from what it was in the maps. Where a machine is linear in all of its temperatures, late ones
included, what interpolated maps leave is linear in these columns exactly, however the maps were
spaced: interpolation is linear too.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.effects.conditions import Conditions, Signal
from app.effects.driver import Driver
from app.effects.low_pass import FromStart
from app.effects.valid import Range
from app.search.response_average import cautious
from app.search.wander import Wander
from app.units import SECONDS_PER_MIN, unit_of_field

LATE, STATE, ON, START, LEVEL = "late", "state", "on", "start", "level"
OFF_MAPS: Final = "off maps"
"""Forms of columns."""

LATE_MIN: Final = (0.0, 20.0, 80.0)
STATE_MIN: Final = (3.0, 7.0, 15.0, 40.0, 90.0, 200.0, 400.0)
ON_MIN: Final = (5.0, 20.0, 60.0, 200.0, 500.0)
START_MIN: Final = (20.0, 60.0, 200.0)
LEVEL_MIN: Final = 30.0
"""Time constants [min]; that of 0 is the present temperature."""

PER_LEVEL_K: Final = 10.0
"""Unit of the level of all temperatures, in kelvins."""

APART_S: Final = 3600.0
"""Records of sensors that began further apart than this are not compared at their beginning [s]."""

BEYOND: Final = 0.5
"""A column is followed beyond its learnt range by this share of that range, and held from there on:
what is not known there shows in the standard deviation, and is corrected less."""

LONGER: Final = 2.0
"""A response that was learnt from the start of records says nothing of records this much longer."""


ROUNDING: Final = 1e-9
"""Share of its mean variance that is added to a covariance before its root is taken."""


class Column(NamedTuple):
    """One driver among many: its form, the sensor or state, and its time constant [min]."""

    form: str
    name: str
    minutes: float

    @property
    def is_of_state(self) -> bool:
        """Whether a state drives it, not a sensor."""
        return self.form in (STATE, ON)

    @property
    def words(self) -> str:
        """What it is, in words."""
        late = f", {self.minutes:g} min late" if self.minutes else ""
        return {
            LATE: f"the rise of {self.name}{late}",
            STATE: f"{self.name}{late}",
            ON: f"how long {self.name} has been on{late}",
            START: f"the initial offset of {self.name}, dying out over {self.minutes:g} min",
            LEVEL: f"the rise of {self.name}{late}, times the machine's temperature level",
            OFF_MAPS: f"{self.name}{late} above what it was in the maps",
        }[self.form]

    @property
    def unit(self) -> str:
        """Its unit."""
        if self.form == STATE:
            return unit_of_field(self.name) or ""
        return "" if self.form == ON else "K"

    @property
    def signal(self) -> Signal:
        """What it is made of."""
        if self.is_of_state:
            return Signal("state", self.name, 0 if self.form == ON else 1)
        return Signal("temperature", self.name)


class InMaps(NamedTuple):
    """What columns were when the maps were measured.

    Parameters
    ----------
    sensor
        The sensor that the maps follow.
    temperatures_c
        Its temperatures in the maps, rising [°C].
    columns_c
        For each column what it was in each of them [°C].
    goes_on
        Whether the maps' straight lines go on beyond their ends, as the machine's policy has it.
    """

    sensor: str
    temperatures_c: tuple[float, ...]
    columns_c: tuple[tuple[float, ...], ...]
    goes_on: bool = False

    def at(self, column: int, here_c: FloatArray) -> FloatArray:
        """Say what a column is in the maps as they are interpolated, shape (n,) [°C].

        Parameters
        ----------
        column
            Its number.
        here_c : ndarray, shape (n,) [°C]
            Temperatures of the maps' sensor.

        Examples
        --------
        >>> maps = InMaps("frame", (20.0, 30.0), ((20.0, 60.0),), goes_on=True)
        >>> maps.at(0, np.array([19.0, 25.0])).tolist()
        [16.0, 40.0]
        """
        scale, there = np.array(self.temperatures_c), np.array(self.columns_c[column])
        found: FloatArray = np.interp(here_c, scale, there)
        if self.goes_on and scale.size > 1:
            slopes = np.diff(there)[[0, -1]] / np.diff(scale)[[0, -1]]
            found = found + slopes[0] * np.minimum(here_c - scale[0], 0.0)
            found = found + slopes[1] * np.maximum(here_c - scale[-1], 0.0)
        return found


class Zero(NamedTuple):
    """What temperatures are counted from.

    Parameters
    ----------
    references_c
        For each column a temperature [°C]; none: from the first reading of each record.
    level_sensor
        Whose temperature is the level; empty: the mean of all.
    level_c
        The level at which the response is that of the other columns [°C].
    in_maps
        What columns were in the maps, of those that are counted from there (`InMaps`).
    """

    references_c: tuple[float, ...] = ()
    level_sensor: str = ""
    level_c: float = 0.0
    in_maps: InMaps | None = None


class Columns(NamedTuple):
    """The columns at n moments, shape (n, p), and how long the record is then, shape (n,) [s].

    NaN where something is missing.
    """

    values: FloatArray
    age_s: FloatArray


def listed_columns(sensors: Iterable[str], states: Iterable[str]) -> tuple[Column, ...]:
    """List what may drive a component, the same for all machines.

    Parameters
    ----------
    sensors, states
        Names.
    """
    sensors, states = list(sensors), list(states)
    return (
        *(Column(LATE, name, minutes) for minutes in LATE_MIN for name in sensors),
        *(Column(STATE, name, minutes) for name in states for minutes in STATE_MIN),
        *(Column(ON, name, minutes) for name in states for minutes in ON_MIN),
        *(Column(START, name, minutes) for minutes in START_MIN for name in sensors),
        *(Column(LEVEL, name, LEVEL_MIN) for name in sensors),
    )


def group_of(column: Column) -> str:
    """Name the group of columns that share one scale."""
    return (
        f"{LATE} {column.minutes:g}"
        if column.form == LATE
        else (f"{column.form} {column.name}" if column.form in (STATE, ON) else column.form)
    )


def needed_signals(columns: Sequence[Column]) -> dict[Column, float]:
    """Give for each column the time constant of the filter that knows its record [s].

    That of a column which needs no filter of its own is the longest of its sensor's others.
    """
    longest: dict[str, float] = {}
    for column in columns:
        if column.form in (LATE, LEVEL, OFF_MAPS):
            longest[column.name] = max(longest.get(column.name, 0.0), column.minutes)
    return {
        column: SECONDS_PER_MIN
        * (
            longest[column.name]
            if column.form == START or column.minutes == 0.0
            else column.minutes
        )
        for column in columns
    }


def columns_at(columns: Sequence[Column], zero: Zero, conditions: Conditions) -> Columns:
    """Evaluate columns at n moments.

    Parameters
    ----------
    columns
        Which.
    zero
        What temperatures are counted from.
    conditions
        What held then, and before.
    """
    taus = needed_signals(columns)
    past = {
        (column.signal, tau_s): conditions.from_start(column.signal, tau_s)
        for column, tau_s in taus.items()
    }
    n = len(conditions)
    if not columns:
        return Columns(np.empty((n, 0)), np.full(n, np.nan))
    began = np.min([found.moved_s for found in past.values()], axis=0)
    age_s = conditions.times_s - began
    sensors = {c.name: past[c.signal, taus[c]] for c in columns if c.form == START}
    usual = np.median([found.first for found in sensors.values()], axis=0) if sensors else None
    level = (level_at(columns, zero.level_sensor, conditions) - zero.level_c) / PER_LEVEL_K
    values = np.empty((n, len(columns)))
    for j, column in enumerate(columns):
        found = past[column.signal, taus[column]]
        reference = zero.references_c[j] if zero.references_c else found.first
        late = found.outputs
        if column.form in (LATE, OFF_MAPS) and column.minutes == 0.0:
            late = conditions.temperature(column.name)
        if column.form == OFF_MAPS and zero.in_maps is not None:
            own_c = conditions.temperature(zero.in_maps.sensor)
            values[:, j] = late - zero.in_maps.at(j, own_c)
        if column.form in (LATE, LEVEL):
            values[:, j] = late - reference
        if column.form == LEVEL:
            values[:, j] *= level
        if column.form in (STATE, ON):
            values[:, j] = _from_nought(found, conditions.times_s, taus[column])
        if column.form == START and usual is not None:
            left = np.exp(-age_s / taus_of_start(column))
            unlike = np.where(_together(found, sensors), found.first - usual, np.nan)
            values[:, j] = unlike * (-left if zero.references_c else 1.0 - left)
    return Columns(values, age_s)


def level_at(columns: Sequence[Column], sensor: str, conditions: Conditions) -> FloatArray:
    """Give the temperature that is the level, shape (n,) [°C]."""
    if sensor:
        return conditions.temperature(sensor)
    known = {column.name for column in columns if not column.is_of_state}
    if not known:
        return np.zeros(len(conditions))
    found: FloatArray = np.mean([conditions.temperature(n) for n in sorted(known)], axis=0)
    return found


def taus_of_start(column: Column) -> float:
    """Give the time constant by which a difference at the start dies out [s]."""
    return SECONDS_PER_MIN * column.minutes


def _from_nought(found: FromStart, times_s: FloatArray, tau_s: float) -> FloatArray:
    """Take off what the filter began with: before the record the state was 0."""
    result: FloatArray = found.outputs - found.first * np.exp((found.since_s - times_s) / tau_s)
    return result


def _together(found: FromStart, others: dict[str, FromStart]) -> BoolArray:
    """Say where a sensor's record began when the others' did."""
    usual = np.median([other.since_s for other in others.values()], axis=0)
    result: BoolArray = np.abs(found.since_s - usual) <= APART_S
    return result


class Outside(NamedTuple):
    """A column that lies outside where it was learnt at some of n moments."""

    column: Column
    learnt: Range
    values: FloatArray
    is_beyond: BoolArray


class Told(NamedTuple):
    """What a response says at n moments, shape (n,) each.

    `mean` is what was learnt, `learnt` and `wander` the standard deviations of that and of what
    no driver explains, the jump as a set-up begins included, `corrected` what is corrected of it,
    `is_held` says where a column lies at the edge of where it was learnt.
    """

    mean: FloatArray
    learnt: FloatArray
    wander: FloatArray
    corrected: FloatArray
    is_held: BoolArray


@dataclass(frozen=True)
class Responding(Driver):
    """The corrected part of a response [the component's unit].

    Parameters
    ----------
    columns
        What drives it: form, name and time constant [min] of each.
    references_c, level_sensor, level_c
        As in `Zero`.
    ranges
        Each column's smallest and largest value where it was learnt.
    until_s
        When each stretch of the response ends [s]; the last one goes on.
    coefficients
        Of each stretch, one for each column.
    spread
        A square root of the coefficients' covariance in the last stretch, which serves for all
        (`written_root`): collinear columns are known in sum and not apart, so that nothing of it
        can be left out.
    noise
        White noise, wander, and jump (`Wander`); without the last where an older version stored it.
    is_zeroed
        Whether it was learnt from set-ups that were zeroed at their first observation.
    longest_min
        The longest record that it was learnt in [min].
    maps_sensor, maps
        The sensor that the component's maps follow, and what they say where it was learnt:
        temperatures [°C], rising, and errors. What is not sure then goes half back to these
        maps, half to what held when the record began (`cautious`). None: back to the maps.
    counted
        How often caution counts the variances. These are of all set-ups, odd
        ones among them, and what to correct is decided for the usual one.
    in_maps
        Of columns that are counted from what they were in the maps (`InMaps`); None of others.
        Such a response is a straight line through 0 where the maps are right, and what wanders
        beside it does so with a correction as without it: caution counts what was learnt alone.
    """

    name: ClassVar[str] = "response"
    columns: tuple[Column, ...]
    references_c: tuple[float, ...]
    level_sensor: str
    level_c: float
    ranges: tuple[Range, ...]
    until_s: tuple[float, ...]
    coefficients: tuple[tuple[float, ...], ...]
    spread: str
    noise: tuple[float, ...]
    is_zeroed: bool
    longest_min: float
    maps_sensor: str = ""
    maps: tuple[Range, ...] = ()
    counted: float = 1.0
    in_maps: InMaps | None = None

    def __post_init__(self) -> None:
        """Read columns as they are stored."""
        object.__setattr__(self, "columns", tuple(Column(*column) for column in self.columns))
        if self.in_maps is not None:
            object.__setattr__(self, "in_maps", InMaps(*self.in_maps))

    def __hash__(self) -> int:
        """Tell responses apart by their latest coefficients: there are thousands of numbers."""
        return hash((self.columns, self.coefficients[-1]))

    def at(self, conditions: Conditions) -> FloatArray:
        """Give what is corrected, shape (n,)."""
        return self.told(conditions).corrected

    def told(self, conditions: Conditions) -> Told:
        """Say what was learnt, how sure it is, and what of it is corrected."""
        found = columns_at(self.columns, self.zero, conditions)
        return self.told_of(found, conditions.times_s, self._maps_since_start(conditions))

    def told_of(self, found: Columns, times_s: FloatArray, maps: FloatArray | None = None) -> Told:
        """Say the same of columns that are known already.

        Parameters
        ----------
        found
            The columns at n moments.
        times_s : ndarray, shape (n,) [s]
            When.
        maps : ndarray, shape (n,), or None [the component's unit]
            What the maps say has changed since the record began; None: what is not sure goes
            back to them alone.
        """
        values = np.clip(found.values, *self._edges)
        is_held: BoolArray = np.any(found.values != values, axis=1) & np.isfinite(found.age_s)
        if not self.references_c:
            values[found.age_s > LONGER * SECONDS_PER_MIN * self.longest_min] = np.nan
        stretch = np.searchsorted(np.array(self.until_s), times_s, side="right")
        mean = np.einsum("ij,ij->i", values, np.array(self.coefficients)[stretch])
        variance = ((values @ self._root) ** 2).sum(axis=1)
        noise, age_min = Wander(*self.noise), found.age_s / SECONDS_PER_MIN
        # A set-up jumps as it begins with a correction as without it: caution does not count that.
        wander, slow = (
            np.sqrt(np.maximum(one.variance(age_min, is_zeroed=not self.references_c), 0.0))
            for one in (noise, noise._replace(jump=0.0))
        )
        learnt = np.sqrt(variance)
        maps = np.zeros(mean.shape) if maps is None else maps
        by = np.sqrt(self.counted)
        beside = np.zeros(mean.shape) if self.in_maps is not None else by * slow
        return Told(mean, learnt, wander, cautious(mean, maps, by * learnt, beside), is_held)

    def farthest(self, conditions: Conditions) -> Outside | None:
        """Find the column that lies farthest beyond where it is held; None where none does."""
        found = columns_at(self.columns, self.zero, conditions)
        low, high = self._edges
        beyond = np.maximum(low - found.values, found.values - high)
        # Of a component that is not asked for there are no moments, and none of them lies outside.
        largest = np.max(np.nan_to_num(beyond, nan=0.0), axis=0, initial=0.0)
        share = largest / np.maximum(high - low, 1e-12)
        at = int(np.argmax(share))
        if share[at] <= 0.0:
            return None
        values = found.values[:, at]
        return Outside(self.columns[at], self.ranges[at], values, beyond[:, at] > 0.0)

    @property
    def signals(self) -> tuple[tuple[Signal, float | None], ...]:
        """Every signal with every time constant of its filters."""
        taus = needed_signals(self.columns)
        return tuple(dict.fromkeys((column.signal, tau_s) for column, tau_s in taus.items()))

    @property
    def zero(self) -> Zero:
        """What temperatures are counted from."""
        return Zero(self.references_c, self.level_sensor, self.level_c, self.in_maps)

    @property
    def is_held_by_signal(self) -> bool:
        """Its columns have ranges of their own."""
        return False

    @property
    def holds_itself(self) -> bool:
        """Its columns have ranges of their own."""
        return True

    def why_missing(self, conditions: Conditions) -> str:
        """Say which condition is missing where it is NaN."""
        if np.isfinite(self.at(conditions)).all():
            return ""
        for signal, tau_s in self.signals:
            here = conditions.from_start(signal, tau_s or 0.0)
            if np.isnan(here.outputs).any():
                return f"no record of {signal.name} up to that time"
            if signal.kind == "temperature" and np.isnan(conditions.temperature(signal.name)).any():
                return conditions.why_missing(signal)
        age_min = columns_at(self.columns, self.zero, conditions).age_s / SECONDS_PER_MIN
        if not self.references_c and (age_min > LONGER * self.longest_min).any():
            return (
                f"it was learnt within the first {self.longest_min:.0f} min of a record, and this "
                f"record began {np.nanmax(age_min):.0f} min ago"
            )
        return "the records of its sensors did not start together"

    def _maps_since_start(self, conditions: Conditions) -> FloatArray | None:
        """Say what the maps have changed by since the record began, shape (n,)."""
        if not self.maps:
            return None
        own = Column(LATE, self.maps_sensor, 0.0)
        first_c = conditions.from_start(own.signal, needed_signals(self.columns)[own]).first
        return changed_by(self.maps, conditions.temperature(self.maps_sensor), first_c)

    @cached_property
    def _edges(self) -> tuple[FloatArray, FloatArray]:
        low, high = np.array(self.ranges).T
        by = BEYOND * (high - low)
        return low - by, high + by

    @cached_property
    def _root(self) -> FloatArray:
        return read_root(self.spread, len(self.columns))


def changed_by(maps: Sequence[Range], here_c: FloatArray, first_c: FloatArray) -> FloatArray:
    """Say by how much errors differ between two temperatures, shape (n,).

    Parameters
    ----------
    maps
        Temperatures [°C], rising, and errors; held at their ends.
    here_c, first_c : ndarray, shape (n,) [°C]

    Examples
    --------
    >>> changed_by([(20.0, 0.0), (30.0, 5.0)], np.array([24.0]), np.array([22.0])).tolist()
    [1.0]
    """
    temperatures_c, errors = np.array(maps).T
    now, then = (np.interp(t, temperatures_c, errors) for t in (here_c, first_c))
    found: FloatArray = now - then
    return found


def written_root(covariance: FloatArray) -> str:
    """Write the lower triangle of a covariance's Cholesky root: 32 bit numbers in base 64.

    Parameters
    ----------
    covariance : ndarray, shape (p, p)
        Positive definite but for rounding.
    """
    slack = ROUNDING * np.diag(covariance).mean() * np.eye(len(covariance))
    root = np.linalg.cholesky(covariance + slack)
    packed = root[np.tril_indices(len(root))].astype("<f4")
    return base64.b64encode(packed.tobytes()).decode("ascii")


def read_root(written: str, p: int) -> FloatArray:
    """Read what `written_root` wrote of p coefficients, shape (p, p).

    Examples
    --------
    >>> read_root(written_root(np.diag([4.0, 9.0])), 2).round(3).tolist()
    [[2.0, 0.0], [0.0, 3.0]]
    """
    root = np.zeros((p, p))
    root[np.tril_indices(p)] = np.frombuffer(base64.b64decode(written), dtype="<f4")
    return root
