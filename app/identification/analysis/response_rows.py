"""The set-ups of one component as a response is learnt from them, and as it is stored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from app.arrays import FloatArray, IntArray, to_significant
from app.effects.conditions import Conditions
from app.effects.observations import ObservationRows
from app.effects.response_columns import (
    LATE,
    LEVEL,
    START,
    STATE,
    STATE_MIN,
    Column,
    Columns,
    Zero,
    columns_at,
    group_of,
    level_at,
    listed_columns,
    needed_signals,
)
from app.effects.response_driver import BEYOND, Responding, changed_by, written_root
from app.effects.valid import Range
from app.identification.residuals.residuals import Residuals
from app.search.response import Course, Response
from app.search.response_average import Average
from app.thermal.prediction import predict_component
from app.units import SECONDS_PER_MIN

KNOWN: Final = 0.95
"""A signal takes part if it is known in so much of the rows."""

SHORTEST_MIN: Final = 60.0
"""A set-up shows a course if it lasts so long [min]."""

FEWEST_ROWS: Final = 4
MOST_ROWS: Final = 60
"""Rows of one set-up, evenly spread: more tell little of what changes within minutes."""

AT_ONCE_MIN: Final = 60.0
"""A set-up begins with its record if its first observation follows it within so long [min]."""

CHANGING_MIN: Final = 20.0
"""The response to temperatures late by this may have changed at a date [min]."""

OWN: Final = "own"
"""Group of the present temperature of the component's own sensor."""

MAP_STEPS: Final = 65
"""Temperatures at which the maps are noted beside a response."""

DIGITS: Final = 6


@dataclass(frozen=True, eq=False)
class SetUp:
    """One set-up: its label, and its rows.

    Parameters
    ----------
    label
        Of its verification, and of the set-up where that states several.
    times_s, values, measured : ndarray, shape (n,)
        When, what the model leaves, and what was measured [the component's unit].
    maps : ndarray, shape (n,)
        What the maps say has changed since the record began [the component's unit].
    found
        All columns at these rows.
    is_zeroed
        Whether the first row is its zero.
    """

    label: str
    times_s: FloatArray
    values: FloatArray
    measured: FloatArray
    maps: FloatArray
    found: Columns
    is_zeroed: bool

    @property
    def course(self) -> Course:
        """The set-up as a response is learnt from it."""
        times_min = (self.times_s - self.times_s[0]) / SECONDS_PER_MIN
        columns, began = self.found.values, float(self.times_s[0])
        if not self.is_zeroed:
            return Course(times_min, columns, self.values, False, began)
        return Course(
            times_min[1:], columns[1:] - columns[0], self.from_zero(self.values)[1:], True, began
        )

    def from_zero(self, values: FloatArray) -> FloatArray:
        """Count values as the instrument would read them."""
        return values - values[0] if self.is_zeroed else values


@dataclass(frozen=True, eq=False)
class ResponseRows:
    """All set-ups of one component.

    Parameters
    ----------
    code
        The component.
    own_sensor
        The sensor that its maps follow; empty without maps.
    columns, zero
        What drives it.
    set_ups
        Those that show a course.
    maps
        What the maps say there, over their sensor's temperature (`Responding.maps`); none where
        set-ups are not counted from their start.
    jumps
        Whether set-ups are learnt from as if each zeroed one jumped as it begins.
    """

    code: str
    own_sensor: str
    columns: tuple[Column, ...]
    zero: Zero
    set_ups: Sequence[SetUp]
    maps: tuple[Range, ...] = ()
    jumps: bool = False

    @cached_property
    def groups(self) -> list[str]:
        """Names of the groups of columns, in the order of their numbers."""
        return list(dict.fromkeys(self.group_of(column) for column in self.columns))

    def group_of(self, column: Column) -> str:
        """Name a column's group: that of the sensor that the maps follow is one of its own.

        The maps may be wrong by all that they say, whatever the others' scale.
        """
        return OWN if column == Column(LATE, self.own_sensor, 0.0) else group_of(column)

    @cached_property
    def response(self) -> Response:
        """The set-ups with all columns."""
        numbers = [self.groups.index(self.group_of(column)) for column in self.columns]
        courses = [one.course for one in self.set_ups]
        return Response(courses, np.array(numbers, dtype=np.intp), self.jumps)

    @cached_property
    def changing(self) -> IntArray:
        """The columns of which the response may have changed at a date."""
        is_own = [c.form == LATE and c.minutes == CHANGING_MIN for c in self.columns]
        return np.flatnonzero(is_own)

    @cached_property
    def unsure(self) -> tuple[int, ...]:
        """The groups that say one thing of a whole set-up: how far bodies differed at its start."""
        return tuple(i for i, name in enumerate(self.groups) if name == START)

    def driver(
        self,
        average: Average,
        learnt_from: Sequence[SetUp],
        doubt: float = 1.0,
        counted: float = 1.0,
        *,
        spares_maps: bool = False,
    ) -> Responding:
        """Make what a model version stores of a response.

        Parameters
        ----------
        average
            What was learnt.
        learnt_from
            The set-ups that it was learnt from.
        doubt
            By how much variances are larger than what was learnt says: what set-ups held out show.
        counted
            How often caution counts them.
        spares_maps
            Whether what is not sure goes back to the maps alone.
        """
        values = np.concatenate([one.found.values for one in learnt_from])
        ages_s = np.concatenate([one.found.age_s for one in learnt_from])
        return Responding(
            columns=self.columns,
            references_c=self.zero.references_c,
            level_sensor=self.zero.level_sensor,
            level_c=self.zero.level_c,
            ranges=tuple(
                zip(values.min(axis=0).tolist(), values.max(axis=0).tolist(), strict=True)
            ),
            until_s=tuple(s.until for s in average.stretches[:-1]),
            coefficients=tuple(to_significant(s.mean, DIGITS) for s in average.stretches),
            spread=written_root(doubt * average.stretches[-1].covariance),
            # The jump is of set-ups held out already, which is what doubt stands for.
            noise=tuple(average.noise.larger(doubt)._replace(jump=average.noise.jump)),
            is_zeroed=all(one.is_zeroed for one in learnt_from),
            longest_min=float(ages_s.max()) / SECONDS_PER_MIN,
            maps_sensor="" if spares_maps else self.own_sensor,
            maps=() if spares_maps else self.maps,
            counted=counted,
            in_maps=self.zero.in_maps,
        )


def courses(rows: ObservationRows, code: str) -> int:
    """Count the set-ups in which a component was observed for long enough to show a course."""
    own = rows.of_channel(code)
    return sum(_is_course(rows.times_s[own[part]]) for _, part in _set_ups(rows, own))


def _is_course(times_s: FloatArray) -> bool:
    lasts_min = np.ptp(times_s) / SECONDS_PER_MIN if times_s.size else 0.0
    return bool(times_s.size >= FEWEST_ROWS and lasts_min >= SHORTEST_MIN)


def response_rows(residuals: Residuals, code: str) -> ResponseRows:
    """Lay a component's residuals out by set-up, beside all that may drive them.

    Parameters
    ----------
    residuals
        What the model leaves.
    code
        A component that was observed by itself.
    """
    rows = residuals.rows
    own = rows.of_channel(code)
    conditions = residuals.projection.conditions.take(own)
    columns = listed_columns(*_known(conditions))
    parts = _set_ups(rows, own)
    zeroed = {which for which, part in parts if rows.has_own_zero[own[part]].any()}
    model = residuals.projection.model.find(code)
    own_sensor = model[0].sensor if model else ""
    level = own_sensor if Column(LATE, own_sensor, 0.0) in columns else ""
    level_c = float(np.nanmean(level_at(columns, level, conditions)))
    zero = Zero(level_sensor=level, level_c=level_c)
    found = columns_at(columns, zero, conditions)
    starts_min = [found.age_s[part[0]] / SECONDS_PER_MIN for _, part in parts]
    if len(zeroed) < len(parts) or not all(age <= AT_ONCE_MIN for age in starts_min):
        zero = zero._replace(references_c=_references_c(columns, conditions))
        found = columns_at(columns, zero, conditions)
    values = residuals.values[own]
    maps: tuple[Range, ...] = ()
    changed = np.zeros(own.size)
    if level and not zero.references_c:
        maps, here_c = _maps(residuals, code, own_sensor), conditions.temperature(own_sensor)
        risen_k = found.values[:, columns.index(Column(LATE, own_sensor, 0.0))]
        changed = changed_by(maps, here_c, here_c - risen_k)
    set_ups = []
    for which, part in parts:
        part = part[np.isfinite(found.values[part]).all(axis=1) & np.isfinite(found.age_s[part])]
        if not _is_course(conditions.times_s[part]):
            continue
        part = part[np.unique(np.linspace(0, part.size - 1, MOST_ROWS).round().astype(np.intp))]
        set_ups.append(
            SetUp(
                rows.visit_label(which),
                conditions.times_s[part],
                values[part],
                rows.measured[own[part]],
                changed[part],
                Columns(found.values[part], found.age_s[part]),
                which in zeroed,
            )
        )
    set_ups.sort(key=lambda one: one.times_s[0])
    return ResponseRows(code, own_sensor, columns, zero, set_ups, maps)


def _maps(residuals: Residuals, code: str, sensor: str) -> tuple[Range, ...]:
    """Ask the maps at the place of a component's rows, over the temperatures that were seen."""
    view = residuals.projection.view(code)
    known = view.conditions.temperature(sensor)
    low, high = float(np.nanmin(known)), float(np.nanmax(known))
    by = BEYOND * (high - low)
    asked = np.linspace(low - by, high + by, MAP_STEPS)
    place = np.full(asked.shape, float(view.places.positions_mm[0]))
    found = predict_component(
        residuals.projection.model, code, {sensor: asked}, place, np.zeros(asked.shape)
    )
    said = np.isfinite(found.values)  # beyond them the machine's policy may allow nothing
    here_c, errors = (to_significant(one[said], DIGITS) for one in (asked, found.values))
    return tuple(zip(here_c, errors, strict=True))


def _set_ups(rows: ObservationRows, own: IntArray) -> list[tuple[int, IntArray]]:
    """Part a component's rows by set-up, each in order of time."""
    found = []
    for which in np.unique(rows.visit[own]).tolist():
        part = np.flatnonzero(rows.visit[own] == which)
        found.append((which, part[np.argsort(rows.times_s[own[part]], kind="stable")]))
    return found


def _known(conditions: Conditions) -> tuple[list[str], list[str]]:
    """Name the sensors and the states of which the record is known, and that changed."""
    sensors = [
        name
        for name, values in conditions.temperatures_c.items()
        if _varies(values) and _is_recorded(Column(LATE, name, 80.0), conditions)
    ]
    states = [
        name
        for name in conditions.states
        if _is_recorded(Column(STATE, name, STATE_MIN[0]), conditions)
        and _varies(conditions.from_start(Column(STATE, name, STATE_MIN[0]).signal, 180.0).outputs)
    ]
    return sensors, states


def unrecorded_states(conditions: Conditions) -> list[str]:
    """Name the states that are known at the rows, and not with the readings before them.

    A response needs to know for how long a state has held, and a live table has readings only.
    """
    return [
        name
        for name, values in conditions.states.items()
        if np.isfinite(values).mean() >= KNOWN
        and not _is_recorded(Column(STATE, name, STATE_MIN[0]), conditions)
    ]


def _varies(values: FloatArray) -> bool:
    known = values[np.isfinite(values)]
    return bool(known.size >= KNOWN * values.size and np.ptp(known) > 0.0)


def _is_recorded(column: Column, conditions: Conditions) -> bool:
    tau_s = needed_signals([column])[column]
    return bool(np.isfinite(conditions.from_start(column.signal, tau_s).outputs).mean() >= KNOWN)


def _references_c(columns: Sequence[Column], conditions: Conditions) -> tuple[float, ...]:
    return tuple(
        float(np.nanmean(conditions.temperature(c.name))) if c.form in (LATE, LEVEL) else 0.0
        for c in columns
    )
