"""The columns of a response: what many sensors and states with lags say at a moment.

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

from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.effects.conditions import Conditions, Signal
from app.effects.low_pass import FromStart
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
    """Take off what the filter began with: before the record the state was 0.

    Of a record that did not begin at rest so little of that is left that it may be unread.
    """
    first = np.nan_to_num(found.first)
    result: FloatArray = found.outputs - first * np.exp((found.since_s - times_s) / tau_s)
    return result


def _together(found: FromStart, others: dict[str, FromStart]) -> BoolArray:
    """Say where a sensor's record began when the others' did."""
    usual = np.median([other.since_s for other in others.values()], axis=0)
    result: BoolArray = np.abs(found.since_s - usual) <= APART_S
    return result
