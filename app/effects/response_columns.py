"""The columns of a response: what many sensors and states with lags say at a moment.

Each column is made from the machine's record since its beginning: a temperature or a state, late
by a time constant; the difference of a body from the others when the record began, and how that
dies out; how long the record has lasted; a late temperature times the level of all of them; and
what the maps say. Before the record the machine is taken to have rested at the temperatures of its
first reading, with all states 0. Where nothing changes at first, the record begins when something
does.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.effects.conditions import Conditions, Signal
from app.effects.low_pass import FromStart
from app.effects.valid import Range
from app.units import SECONDS_PER_MIN, unit_of_field

LATE, STATE, TIME, START, LEVEL = "late", "state", "time", "start", "level"
MAPS, OFFSET = "maps", "offset"
"""Forms of columns."""

LADDER_MIN: Final = (20.0, 60.0, 180.0)
QUICK_MIN: Final = 5.0
"""Time constants [min]: some minutes, as the first layers of a body that is suddenly heated take,
and from there by threes."""

OF_RECORD: Final = 1.0 / 3.0
"""Time constants reach so far, as a share of the usual record: what is slower cannot be told from
a ramp, and what is learnt in three hours is not known for ten."""

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
        return self.form == STATE

    @property
    def words(self) -> str:
        """What it is, in words."""
        late = f", {self.minutes:g} min late" if self.minutes else ""
        return {
            LATE: f"the rise of {self.name}{late}",
            STATE: f"{self.name}{late}",
            TIME: f"the time since the start, settling within {self.minutes:g} min",
            START: f"the initial offset of {self.name}, dying out over {self.minutes:g} min",
            LEVEL: f"the rise of {self.name}{late}, times the machine's temperature level",
            MAPS: f"what the maps over {self.name} say",
            OFFSET: "the zero",
        }[self.form]

    @property
    def unit(self) -> str:
        """Its unit; empty where it has none or is that of the component."""
        if self.form == STATE:
            return unit_of_field(self.name) or ""
        return "K" if self.form in (LATE, START, LEVEL) else ""

    @property
    def signal(self) -> Signal:
        """What it is made of."""
        return Signal("state" if self.form == STATE else "temperature", self.name)


class Zero(NamedTuple):
    """What columns are counted from.

    Parameters
    ----------
    references_c
        For each column a temperature [°C]; none: from the first reading of each record.
    level_c
        The mean temperature at which the response is that of the other columns [°C].
    maps
        What the maps say over their sensor's temperature: temperatures [°C], rising, and errors.
    """

    references_c: tuple[float, ...] = ()
    level_c: float = 0.0
    maps: tuple[Range, ...] = ()


class Columns(NamedTuple):
    """The columns at n moments, shape (n, p), and how long the record is then, shape (n,) [s].

    NaN where something is missing.
    """

    values: FloatArray
    age_s: FloatArray


def time_constants_min(usual_min: float) -> tuple[float, ...]:
    """List the time constants that records of a usual length tell apart.

    Examples
    --------
    >>> time_constants_min(300.0)
    (20.0, 60.0)
    """
    return tuple(tau for tau in LADDER_MIN if tau <= OF_RECORD * usual_min)


def listed_columns(
    sensors: Iterable[str],
    states: Iterable[str],
    late_min: Sequence[float],
    maps_sensor: str = "",
    *,
    is_from_start: bool = True,
) -> tuple[Column, ...]:
    """List what may drive a component, the same for all machines.

    Parameters
    ----------
    late_min
        Time constants [min].
    maps_sensor
        The sensor that the component's maps follow; empty: there are none.
    is_from_start
        Whether set-ups are counted from their start; if not, they have an offset instead.
    """
    sensors, states = list(sensors), list(states)
    forms = [
        *(
            Column(LATE, name, minutes)
            for minutes in (0.0, QUICK_MIN, *late_min)
            for name in sensors
        ),
        *(Column(STATE, name, minutes) for minutes in (QUICK_MIN, *late_min) for name in states),
        *(Column(LEVEL, name, late_min[0]) for name in sensors),
    ]
    if is_from_start:
        forms.append(Column(TIME, "", QUICK_MIN))
        forms += [Column(START, name, minutes) for minutes in late_min for name in sensors]
    else:
        forms.append(Column(OFFSET, "", 0.0))
    return (*forms, *([Column(MAPS, maps_sensor, 0.0)] if maps_sensor else []))


def needed_signals(columns: Sequence[Column]) -> dict[Column, float]:
    """Give for each column that follows a signal the time constant of its filter [s].

    That of a column which needs no filter of its own is the longest of its sensor's others.
    """
    # Who needs no filter of its own needs only when the record began, and what was read first: one
    # that is there anyway tells it.
    longest: dict[str, float] = {}
    for column in columns:
        if column.form in (LATE, LEVEL):
            longest[column.name] = max(longest.get(column.name, 0.0), column.minutes)
    return {
        column: SECONDS_PER_MIN
        * (
            longest[column.name]
            if column.form in (START, MAPS) or column.minutes == 0.0
            else column.minutes
        )
        for column in columns
        if column.name
    }


def columns_at(columns: Sequence[Column], zero: Zero, conditions: Conditions) -> Columns:
    """Evaluate columns at n moments.

    Parameters
    ----------
    zero
        What temperatures are counted from.
    """
    taus = needed_signals(columns)
    past = {
        (column.signal, tau_s): conditions.from_start(column.signal, tau_s)
        for column, tau_s in taus.items()
    }
    n = len(conditions)
    if not columns:
        return Columns(np.empty((n, 0)), np.full(n, np.nan))
    began = np.min([start.moved_s for start in past.values()], axis=0)
    age_s = conditions.times_s - began
    sensors = {c.name: past[c.signal, taus[c]] for c in columns if c.form == START}
    usual = np.median([start.first for start in sensors.values()], axis=0) if sensors else None
    level = (level_at(columns, conditions) - zero.level_c) / PER_LEVEL_K
    values = np.ones((n, len(columns)))
    for j, column in enumerate(columns):
        if column.form == TIME:
            values[:, j] = _settled(age_s, column)
        if column not in taus:
            continue
        start = past[column.signal, taus[column]]
        reference = zero.references_c[j] if zero.references_c else start.first
        late = start.outputs if column.minutes else conditions.temperature(column.name)
        if column.form in (LATE, LEVEL):
            values[:, j] = late - reference
        if column.form == LEVEL:
            values[:, j] *= level
        if column.form == MAPS:
            values[:, j] = changed_by(zero.maps, late, reference)
        if column.form == STATE:
            values[:, j] = _from_nought(start, conditions.times_s, taus[column])
        if column.form == START and usual is not None:
            unlike = np.where(_together(start, sensors), start.first - usual, np.nan)
            values[:, j] = unlike * _settled(age_s, column)
    return Columns(values, age_s)


def changed_by(
    maps: Sequence[Range], here_c: FloatArray, first_c: FloatArray | float
) -> FloatArray:
    """Say by how much the maps' errors differ between two temperatures, shape (n,).

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
    result: FloatArray = now - then
    return result


def level_at(columns: Sequence[Column], conditions: Conditions) -> FloatArray:
    """Give the mean temperature of all sensors, shape (n,) [°C]."""
    names = {column.name for column in columns if column.form == LATE}
    if not names:
        return np.zeros(len(conditions))
    result: FloatArray = np.mean([conditions.temperature(n) for n in sorted(names)], axis=0)
    return result


def _settled(age_s: FloatArray, column: Column) -> FloatArray:
    """Say how far what began with the record has settled, shape (n,)."""
    result: FloatArray = 1.0 - np.exp(-age_s / (SECONDS_PER_MIN * column.minutes))
    return result


def _from_nought(start: FromStart, times_s: FloatArray, tau_s: float) -> FloatArray:
    """Take off what the filter began with: before the record the state was 0.

    Of a record that did not begin at rest so little of that is left that it may be unread.
    """
    # The filter is linear: started at `first` it is that started at 0 plus first e^(−t/τ).
    first = np.nan_to_num(start.first)
    result: FloatArray = start.outputs - first * np.exp((start.since_s - times_s) / tau_s)
    return result


def _together(start: FromStart, others: dict[str, FromStart]) -> BoolArray:
    """Say where a sensor's record began when the others' did."""
    usual = np.median([other.since_s for other in others.values()], axis=0)
    result: BoolArray = np.abs(start.since_s - usual) <= APART_S
    return result
