"""When the machine is visited, and what is measured in each visit.

A visit measures some components along their lines (positions with random offsets, every one
approached from both sides, one of them twice) and points of the work volume with tools of
different lengths (a few of them twice). Components take turns, so that all are measured
equally often. A record measures the same places again and again. Later visits go to places of
their own, as visits do, but for those of a record, which go to the record's.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from app.simulation.undeclared.base_machine import TRAVELS_MM
from app.simulation.undeclared.components import CODES, COMPONENTS, FloatArray
from app.simulation.undeclared.conditions import RECORD_BEGINS_MIN, Conditions
from app.simulation.undeclared.duty_cycle import DAY_MIN, is_day_of_rest
from app.simulation.undeclared.history import HIDDEN_DAYS
from app.simulation.undeclared.observations import POINT, Observations

OPENS_MIN: Final = 6 * 60
CLOSES_MIN: Final = 23 * 60
"""Visits of a day lie between these minutes: also when the machine cools down."""

SHARE_OF_POINTS: Final = 0.2
POSITIONS_A_LINE: Final = 3
ROWS_A_LINE: Final = 2 * (POSITIONS_A_LINE + 1)
FEWEST_WITH_LINES: Final = 12
"""A record's block of fewer observations measures points alone."""

TOOL_LENGTHS_MM: Final = (80.0, 150.0, 220.0)


@dataclass(frozen=True)
class _Row:
    """One observation of a visit, without its time."""

    component: int
    point_mm: tuple[float, float, float]
    direction: tuple[int, int, int]
    tool_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)


def visit_starts(rng: np.random.Generator, conditions: Conditions) -> FloatArray:
    """Draw when the visits begin, or say when the blocks of a record do.

    Returns
    -------
    ndarray, shape (v,) [min]
        Increasing minutes since the first reading; no two visits overlap. The later visits last.
    """
    first = conditions.history_days
    last = first + conditions.visit_days
    if conditions.block_every_min is None:
        return _spread(rng, first, last, conditions.visits + conditions.later_visits, conditions)
    begins = first * DAY_MIN + RECORD_BEGINS_MIN
    blocks = begins + np.arange(conditions.visits) * np.float64(conditions.block_every_min)
    if not conditions.later_visits:
        return blocks
    after = first + conditions.record_days
    return np.concatenate([blocks, _spread(rng, after, last, conditions.later_visits, conditions)])


def _spread(
    rng: np.random.Generator, first: int, last: int, visits: int, conditions: Conditions
) -> FloatArray:
    """Spread visits over the working days from the first to before the last."""
    days = [day for day in range(first, last) if not is_day_of_rest(day + HIDDEN_DAYS)]
    room = CLOSES_MIN - OPENS_MIN
    lasts = int(np.ceil(conditions.visit_min)) + 2
    starts = []
    for i, day in enumerate(days):
        here = (i + 1) * visits // len(days) - i * visits // len(days)
        free = room - here * lasts
        if free < 0:
            raise ValueError(
                f"expected days for {visits} visits of {conditions.visit_min:.0f} min, "
                f"got {conditions.visit_days} days"
            )
        pauses = np.sort(rng.integers(0, free + 1, here))
        starts.append(day * DAY_MIN + OPENS_MIN + pauses + lasts * np.arange(here))
    return np.concatenate(starts).astype(float)


def plan_observations(
    rng: np.random.Generator, conditions: Conditions, starts_min: FloatArray
) -> Observations:
    """Draw what is observed in all visits.

    Parameters
    ----------
    starts_min : ndarray, shape (v,) [min]
        When the visits begin.

    Returns
    -------
    Observations
        In order of time.
    """
    turns = _Turns(rng)
    rows, times, visits = [], [], []
    planned: list[_Row] = []
    for visit, start in enumerate(starts_min):
        if not planned or conditions.new_places or not conditions.is_record:
            planned = _visit(rng, conditions.observations_per_visit, turns)
        rows += planned
        seconds = conditions.observation_interval_s * np.arange(len(planned))
        times.append(start + seconds / 60.0)
        visits += [visit] * len(planned)
    return Observations(
        np.concatenate(times),
        np.array(visits),
        np.array([row.component for row in rows]),
        np.array([row.point_mm for row in rows]),
        np.array([row.direction for row in rows], dtype=float),
        np.array([row.tool_mm for row in rows]),
    )


class _Turns:
    """Lets components take turns in random order."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._waiting: list[str] = []

    def next(self, count: int) -> list[str]:
        """Take so many different components, at most all."""
        chosen: list[str] = []
        while len(chosen) < min(count, len(CODES)):
            if not self._waiting:
                self._waiting = [str(code) for code in self._rng.permutation(CODES)]
            fresh = next((c for c in self._waiting if c not in chosen), None)
            if fresh is None:
                self._waiting += [str(code) for code in self._rng.permutation(CODES)]
                continue
            self._waiting.remove(fresh)
            chosen.append(fresh)
        return chosen


def _visit(rng: np.random.Generator, observations: int, turns: _Turns) -> list[_Row]:
    if observations < FEWEST_WITH_LINES:
        return _points(rng, observations)
    for_lines = round((1.0 - SHARE_OF_POINTS) * observations)
    rows: list[_Row] = []
    for code in turns.next(max(1, for_lines // ROWS_A_LINE)):
        rows += _line(rng, code)
    return rows + _points(rng, observations - len(rows))


def _line(rng: np.random.Generator, code: str) -> list[_Row]:
    """Go along the axis and back; the positions of no two lines share a step."""
    component, number = COMPONENTS[code], CODES.index(code)
    if component.axis is None:
        return [_Row(number, (0.0, 0.0, 0.0), (0, 0, 0))] * 2
    travel = TRAVELS_MM[component.axis]
    offsets = rng.uniform(0.0, 1.0, POSITIONS_A_LINE)
    along = np.round((np.arange(POSITIONS_A_LINE) + offsets) / POSITIONS_A_LINE * travel, 3)
    again = int(rng.integers(POSITIONS_A_LINE))
    forward = np.insert(along, again, along[again])
    rows = []
    for sign, positions in ((1, forward), (-1, forward[::-1])):
        direction, point = [0, 0, 0], [0.0, 0.0, 0.0]
        direction[component.axis] = sign
        for position in positions:
            point[component.axis] = float(position)
            rows.append(_Row(number, (point[0], point[1], point[2]), tuple(direction)))  # type: ignore[arg-type]
    return rows


def _points(rng: np.random.Generator, count: int) -> list[_Row]:
    """Measure points, a quarter of them twice."""
    different = count - count // 4
    rows = []
    for _ in range(different):
        x, y, z = (round(rng.uniform(0.05, 0.95) * travel, 3) for travel in TRAVELS_MM)
        a, b, c = (int(sign) for sign in rng.choice([-1, 1], 3))
        length = float(rng.choice(TOOL_LENGTHS_MM))
        rows.append(_Row(POINT, (x, y, z), (a, b, c), (0.0, 0.0, length)))
    return rows + rows[: count - different]
