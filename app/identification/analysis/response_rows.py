"""The set-ups of one component as a response is learnt from them, and as it is stored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from app.arrays import FloatArray, IntArray, to_significant
from app.effects.campaign_view import KNOWN_SHARE
from app.effects.conditions import Conditions, Signal
from app.effects.observations import ObservationRows
from app.effects.response_columns import (
    LATE,
    LEVEL,
    MAPS,
    OFFSET,
    QUICK_MIN,
    START,
    STATE,
    TIME,
    Column,
    Columns,
    Zero,
    columns_at,
    level_at,
    listed_columns,
    time_constants_min,
)
from app.effects.response_driver import BEYOND, Reach, Responding, written, written_root
from app.effects.valid import Range
from app.identification.residuals.residuals import Residuals
from app.search.priors import MAPS_SHARE, SWING
from app.search.response import Course, Fitted, Group, Response
from app.thermal.prediction import predict_component
from app.units import SECONDS_PER_MIN

SHORTEST_MIN: Final = 60.0
"""A set-up shows a course if it lasts so long [min]."""

FEWEST_ROWS: Final = 4
MOST_ROWS: Final = 60
"""Rows of one set-up, evenly spread: more tell little of what changes within minutes."""

LEARNT_ROWS: Final = (400, 40)
"""Of these, so many of all set-ups together are learnt from, and so many of one at most."""

MOST_SET_UPS: Final = 200
"""The latest ones."""

FEWEST: Final = 6
"""So many set-ups are needed. Of draws from the runs of two measured machines, responses learnt
from one to three left more of the others than the maps did in 19 of 36, from four in 2 of 12, from
six in none of 12."""

STRETCHES: Final = 12
"""Fewer records that count from no zero of their own are cut into so many set-ups."""

GAP_S: Final = 3600.0
"""What counts from no zero is one record while no pause is longer [s]."""

AT_ONCE_MIN: Final = 60.0
"""A set-up begins with its record if its first observation follows it within so long [min]."""

MAP_STEPS: Final = 65
"""Temperatures at which the maps are noted beside a response."""

LEAST_SWING: Final = 0.05
"""Share of the middle sensor's swing from which that of others is no smaller: it is noise."""

DIGITS: Final = 6

OF_SENSORS: Final = "the temperatures, present and delayed"
OF_STARTS: Final = "how far the sensors differed at the start"
OF_LEVEL: Final = "how warm the machine is as a whole"
OF_TIME: Final = "the first minutes of a set-up"
OF_MAPS: Final = "the maps, as far as they say too much"
OF_ZERO: Final = "the zero"
"""What a group of drivers is, in words."""


@dataclass(frozen=True, eq=False)
class SetUp:
    """One set-up: its label, and its rows.

    Parameters
    ----------
    label
        Of its verification, and of the set-up where that states several.
    times_s, values, measured : ndarray, shape (n,)
        When, what the model leaves, and what was measured [the component's unit].
    is_zeroed
        Whether the first row is its zero.
    record
        Number of the record that it was cut from; None: of none.
    """

    label: str
    times_s: FloatArray
    values: FloatArray
    measured: FloatArray
    found: Columns
    is_zeroed: bool
    record: int | None = None

    @property
    def began_s(self) -> float:
        """When it began: of a set-up with a zero of its own when its record did [s]."""
        return float(self.times_s[0] - (self.found.age_s[0] if self.is_zeroed else 0.0))

    @property
    def course(self) -> Course:
        """The set-up as a response is learnt from it."""
        first = 1 if self.is_zeroed else 0
        columns = self.found.values
        # Pieces of one record count from one time: its wander goes on from one to the next.
        origin_s = self.times_s[0] if self.record is None else 0.0
        return Course(
            ((self.times_s - origin_s) / SECONDS_PER_MIN)[first:],
            columns[first:] - columns[0] if first else columns,
            self.from_zero(self.values)[first:],
            self.is_zeroed,
            self.began_s,
            self.record,
        )

    def thinned(self, most: int) -> SetUp:
        """Keep at most so many rows, evenly spread, the first among them."""
        n = len(self.times_s)
        chosen = np.unique(np.linspace(0, n - 1, min(most, n)).round().astype(np.intp))
        return replace(
            self,
            times_s=self.times_s[chosen],
            values=self.values[chosen],
            measured=self.measured[chosen],
            found=Columns(self.found.values[chosen], self.found.age_s[chosen]),
        )

    def from_zero(self, values: FloatArray) -> FloatArray:
        """Count values as the instrument would read them."""
        return values - values[0] if self.is_zeroed else values


@dataclass(frozen=True, eq=False)
class ResponseRows:
    """All set-ups of one component.

    Parameters
    ----------
    set_ups
        Those that show a course.
    """

    code: str
    columns: tuple[Column, ...]
    zero: Zero
    set_ups: Sequence[SetUp]

    @cached_property
    def response(self) -> Response:
        """The set-ups as they are learnt from."""
        total, most = LEARNT_ROWS
        each = int(np.clip(total // max(len(self.set_ups), 1), FEWEST_ROWS, most))
        courses = [set_up.thinned(each + set_up.is_zeroed).course for set_up in self.set_ups]
        expected = np.array([-MAPS_SHARE if c.form == MAPS else 0.0 for c in self.columns])
        return Response(courses, self._groups(courses), expected)

    @property
    def is_from_start(self) -> bool:
        """Whether set-ups are counted from where their records start."""
        return not self.zero.references_c

    def reach(self, set_ups: Sequence[SetUp]) -> Reach:
        """Say where some set-ups have shown it."""
        seen = [set_up.found for set_up in set_ups]
        return Reach.of(self.columns, seen, is_from_start=self.is_from_start)

    def driver(self, fitted: Fitted) -> Responding:
        """Make what a model version stores of a response.

        It is sure of the next set-up as of one that follows as set-ups usually do.
        """
        reach = self.reach(self.set_ups)
        days_s = np.unique(fitted.response.days)
        follows_s = float(np.median(np.diff(days_s))) if days_s.size > 1 else np.inf
        means = [fitted.common(), *(fitted.coefficients(day) for day in days_s.tolist())]
        longest_s = max(float(set_up.found.age_s.max()) for set_up in self.set_ups)
        return Responding(
            columns=self.columns,
            references_c=self.zero.references_c,
            level_c=self.zero.level_c,
            ranges=tuple(reach.ranges),
            days_s=tuple(days_s.tolist()),
            drift_span_s=fitted.scales.drift_span,
            coefficients=written(np.concatenate(means)),
            spread=written_root(fitted.covariance(float(days_s[-1]) + follows_s)),
            noise=tuple(fitted.scales.noise),
            longest_min=longest_s / SECONDS_PER_MIN,
            maps=self.zero.maps,
        )

    def _groups(self, courses: Sequence[Course]) -> list[Group]:
        """Part the coefficients: what lasts and what passes, of each kind of drivers.

        What lasts has a gain that stays; what passes is how far a driver at once is from itself
        late, and dies out.
        """
        size = self._sizes(np.concatenate([course.columns for course in courses]))
        place = {column: i for i, column in enumerate(self.columns)}

        def lasting(columns: Sequence[Column]) -> FloatArray:
            directions = np.zeros((len(self.columns), len(columns)))
            for k, column in enumerate(columns):
                directions[place[column], k] = size[place[column]]
            return directions

        def passing(columns: Sequence[Column]) -> FloatArray:
            at_once: dict[str, Column] = {}
            for column in columns:
                quickest = at_once.setdefault(column.name, column)
                if column.minutes < quickest.minutes:
                    at_once[column.name] = column
            late = [c for c in columns if at_once[c.name] != c]
            return lasting([at_once[c.name] for c in late]) - lasting(late)

        by_form = {
            form: [c for c in self.columns if c.form == form]
            for form in (LATE, STATE, TIME, START, LEVEL, MAPS, OFFSET)
        }
        late = by_form[LATE]
        steady = lasting([c for c in late if c.minutes != QUICK_MIN])
        groups = [
            Group(OF_SENSORS, steady, steady),
            Group(OF_SENSORS, passing(late), steady),
            Group(OF_STARTS, lasting(by_form[START]), steady),
            Group(OF_LEVEL, lasting(by_form[LEVEL]), steady),
        ]
        for name in dict.fromkeys(c.name for c in by_form[STATE]):
            columns = [c for c in by_form[STATE] if c.name == name]
            quick = lasting([c for c in columns if c.minutes == QUICK_MIN])
            groups += [Group(name, quick, quick), Group(name, passing(columns), quick)]
        for words, form in ((OF_TIME, TIME), (OF_ZERO, OFFSET)):
            directions = lasting(by_form[form])
            groups.append(Group(words, directions, directions))
        maps = lasting(by_form[MAPS])
        groups.append(Group(OF_MAPS, maps, maps, MAPS_SHARE))
        return [group for group in groups if group.directions.shape[1]]

    def _sizes(self, columns: FloatArray) -> FloatArray:
        """Say how large each coefficient is expected beside its group's scale, shape (p,)."""
        swing = {
            c.name: float(np.sqrt(np.mean(columns[:, i] ** 2)))
            for i, c in enumerate(self.columns)
            if c.form == LATE and c.minutes == 0.0
        }
        middle = float(np.median(list(swing.values()))) if swing else 0.0
        sizes = np.ones(len(self.columns))
        for i, column in enumerate(self.columns):
            if column.form in (LATE, START, LEVEL) and middle:
                column_swing = max(swing[column.name], LEAST_SWING * middle)
                sizes[i] = (middle / column_swing) ** SWING
        return sizes


def response_rows(residuals: Residuals, code: str) -> ResponseRows:
    """Lay a component's residuals out by set-up, beside all that may drive them.

    Parameters
    ----------
    code
        A component that was observed by itself.
    """
    rows = residuals.rows
    rows_of_code = rows.of_channel(code)
    conditions = residuals.projection.conditions.take(rows_of_code)
    parts = [
        stretch
        for stretch in _parts(rows, rows_of_code)
        if _is_course(rows.times_s[rows_of_code[stretch.rows]])
    ]
    zeroed = [stretch.is_zeroed for stretch in parts]
    lasts_min = [
        float(np.ptp(rows.times_s[rows_of_code[stretch.rows]])) / SECONDS_PER_MIN
        for stretch in parts
    ]
    late_min = time_constants_min(float(np.median(lasts_min))) if parts else ()
    sensors, states = _usable_signals(conditions, late_min) if late_min else ([], [])
    if not sensors:
        return ResponseRows(code, (), Zero(), ())
    model = residuals.projection.model.find(code)
    maps_sensor = model[0].sensor if model and model[0].sensor in sensors else ""
    maps = _maps(residuals, code, maps_sensor) if maps_sensor else ()
    if not maps:
        maps_sensor = ""

    def at(*, is_from_start: bool) -> tuple[tuple[Column, ...], Zero, Columns]:
        columns = listed_columns(
            sensors, states, late_min, maps_sensor, is_from_start=is_from_start
        )
        if all(zeroed):  # a zero for all of them shows in none
            columns = tuple(column for column in columns if column.form != OFFSET)
        level_c = float(np.nanmean(level_at(columns, conditions)))
        references_c = () if is_from_start else _references_c(columns, conditions)
        zero = Zero(references_c, level_c, maps)
        return columns, zero, columns_at(columns, zero, conditions)

    columns, zero, columns_at_rows = at(is_from_start=True)
    starts_min = [columns_at_rows.age_s[stretch.rows[0]] / SECONDS_PER_MIN for stretch in parts]
    if not all(
        p.is_zeroed and age <= AT_ONCE_MIN for p, age in zip(parts, starts_min, strict=True)
    ):
        columns, zero, columns_at_rows = at(is_from_start=False)
    values = residuals.values[rows_of_code]
    is_usable = np.isfinite(columns_at_rows.values).all(axis=1) & np.isfinite(columns_at_rows.age_s)
    usable = [replace(stretch, rows=stretch.rows[is_usable[stretch.rows]]) for stretch in parts]
    usable = [stretch for stretch in usable if _is_course(conditions.times_s[stretch.rows])]
    set_ups = []
    for stretch in _cut(usable):
        part = stretch.rows
        whole = SetUp(
            rows.visit_label(int(rows.visit[rows_of_code[part[0]]])),
            conditions.times_s[part],
            values[part],
            rows.measured[rows_of_code[part]],
            Columns(columns_at_rows.values[part], columns_at_rows.age_s[part]),
            stretch.is_zeroed,
            stretch.record,
        )
        set_ups.append(whole.thinned(MOST_ROWS))
    set_ups.sort(key=lambda set_up: set_up.times_s[0])
    return ResponseRows(code, columns, zero, set_ups[-MOST_SET_UPS:])


@dataclass(frozen=True, eq=False)
class _Part:
    """Rows of a set-up in order of time, whether the first is its zero, and of which record."""

    rows: IntArray
    is_zeroed: bool
    record: int | None = None


def _parts(rows: ObservationRows, rows_of_code: IntArray) -> list[_Part]:
    """Part a component's rows: each set-up with a zero of its own, and the records of all others.

    What was sent one by one, and has one zero, is one record as if it had been sent together.
    """
    order = np.argsort(rows.times_s[rows_of_code], kind="stable")
    has_zero = rows.has_own_zero[rows_of_code[order]]
    visit = rows.visit[rows_of_code[order]]
    zeroed = [order[has_zero & (visit == which)] for which in np.unique(visit[has_zero])]
    together = order[~has_zero]
    pauses = np.flatnonzero(np.diff(rows.times_s[rows_of_code[together]]) > GAP_S) + 1
    records = [part for part in np.split(together, pauses) if part.size]
    return [_Part(part, True) for part in zeroed] + [_Part(part, False) for part in records]


def _cut(parts: Sequence[_Part]) -> list[_Part]:
    """Cut records without a zero of their own into stretches where there are too few of them."""
    records = [part for part in parts if not part.is_zeroed]
    if len(parts) >= FEWEST or not records:
        return list(parts)
    pieces = [part for part in parts if part.is_zeroed]
    for number, record in enumerate(records):
        count = min(-(-STRETCHES // len(records)), len(record.rows) // FEWEST_ROWS)
        pieces += [_Part(rows, False, number) for rows in np.array_split(record.rows, count)]
    return pieces


def _is_course(times_s: FloatArray) -> bool:
    lasts_min = np.ptp(times_s) / SECONDS_PER_MIN if times_s.size else 0.0
    return bool(times_s.size >= FEWEST_ROWS and lasts_min >= SHORTEST_MIN)


def _maps(residuals: Residuals, code: str, sensor: str) -> tuple[Range, ...]:
    """Ask the maps at the place of a component's rows, over the temperatures that were seen."""
    view = residuals.projection.view(code)
    temperatures_c = view.conditions.temperature(sensor)
    low, high = float(np.nanmin(temperatures_c)), float(np.nanmax(temperatures_c))
    by = BEYOND * (high - low)
    nodes_c = np.linspace(low - by, high + by, MAP_STEPS)
    place = np.full(nodes_c.shape, float(view.places.positions_mm[0]))
    prediction = predict_component(
        residuals.projection.model, code, {sensor: nodes_c}, place, np.zeros(nodes_c.shape)
    )
    predicted = np.isfinite(prediction.values)  # beyond them the machine's policy may allow nothing
    here_c, errors = (
        to_significant(array[predicted], DIGITS) for array in (nodes_c, prediction.values)
    )
    return tuple(zip(here_c, errors, strict=True))


def _usable_signals(
    conditions: Conditions, late_min: Sequence[float]
) -> tuple[list[str], list[str]]:
    """Name the sensors and the states of which the record is known, and that changed."""
    sensors = [
        name
        for name, values in conditions.temperatures_c.items()
        if _varies(values) and _is_recorded(Signal("temperature", name), late_min[-1], conditions)
    ]
    states = [
        name
        for name in conditions.states
        if _is_recorded(Signal("state", name), QUICK_MIN, conditions)
        and _varies(_late(Signal("state", name), QUICK_MIN, conditions))
    ]
    return sensors, states


def unrecorded_states(conditions: Conditions) -> list[str]:
    """Name the states that are known at the rows, and not with the readings before them.

    A response needs to know for how long a state has held, and a live table has readings only.
    """
    return [
        name
        for name, values in conditions.states.items()
        if np.isfinite(values).mean() >= KNOWN_SHARE
        and not _is_recorded(Signal("state", name), QUICK_MIN, conditions)
    ]


def _varies(values: FloatArray) -> bool:
    finite = values[np.isfinite(values)]
    return bool(finite.size >= KNOWN_SHARE * values.size and np.ptp(finite) > 0.0)


def _late(signal: Signal, minutes: float, conditions: Conditions) -> FloatArray:
    return conditions.from_start(signal, SECONDS_PER_MIN * minutes).outputs


def _is_recorded(signal: Signal, minutes: float, conditions: Conditions) -> bool:
    return bool(np.isfinite(_late(signal, minutes, conditions)).mean() >= KNOWN_SHARE)


def _references_c(columns: Sequence[Column], conditions: Conditions) -> tuple[float, ...]:
    return tuple(
        float(np.nanmean(conditions.temperature(c.name))) if c.form in (LATE, LEVEL, MAPS) else 0.0
        for c in columns
    )
