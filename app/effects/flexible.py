"""Flexible versions of a hypothesis: what it would be if its shape were only roughly right.

An effect that the library does not have is often imitated by one that it has: a bow by a profile
that comes and goes, a gradient with an offset by a late speed. Where the name is right, none of
these versions explains anything; one that does says that the name stands for something else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Final, TypeAlias

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.effects.conditions import Signal
from app.effects.driver import Always
from app.effects.projection import Projection, View
from app.effects.shape import Everywhere, OfPosition, Shape
from app.effects.term import Term
from app.search.candidate import OFFSET, Flexible

Weight: TypeAlias = Callable[[Term, View], FloatArray]
"""Gives for a term the factors, shape (m,), of the rows in which it shows."""

POWERS_ALONG: Final = 3
"""Powers of the position along the axis."""

TIME_WAVES: Final = 4
"""Cosines over the time of the campaign: half a period, one, one and a half, two."""

STRETCHES: Final = 24
"""Stretches of time in which it may have a size of its own: so many at most."""

FEWEST_STRETCHES: Final = 4

OTHER_TIMES: Final = (1.0 / 3.0, 3.0)
"""Time constants beside its own, as multiples of it."""

HALF_WIDTHS: Final = (1.0 / 16.0, 1.0 / 8.0, 1.0 / 4.0)
"""Half the widths of dead bands, as shares of the range of a sensor's temperatures."""

OVER_TIME: Final = "its size changes over time"

HYSTERESIS: Final = "it also depends on the way by which its temperature came (hysteresis)"


def flexible_versions(
    projection: Projection,
    unit_terms: Callable[[float | None], Sequence[Sequence[Term]]],
    theta: float | None,
    time_constants: tuple[float, float] | None,
) -> list[Flexible]:
    """List what a hypothesis would add if it were only roughly right.

    Parameters
    ----------
    unit_terms
        Gives for a value of the nonlinear parameter the amplitudes' terms, with coefficient 1.
    time_constants
        Bounds of the nonlinear parameter where that is a time constant; else None.
    """
    amplitudes = unit_terms(theta)
    every = [term for terms in amplitudes for term in terms]
    first = amplitudes[:1]
    by_change = {
        "it varies differently along the axis": _columns(projection, first, _powers()),
        "it depends differently on its driver": _columns(
            projection, amplitudes, _of_driver(projection, every)
        ),
        OVER_TIME: _columns(projection, amplitudes, _waves(projection)),
        "its size changes from visit to visit": _columns(projection, first, _stretches(projection)),
        "its components do not all show it alike": _columns(
            projection, amplitudes, _by_component(every)
        ),
        OFFSET: _offset(projection, every),
    }
    if time_constants is not None and theta is not None:
        low, high = time_constants
        beside = [t for m in OTHER_TIMES if low <= (t := m * theta) <= high]
        by_change["part of it responds faster or slower"] = np.hstack(
            [
                np.zeros((len(projection.rows), 0)),
                *(projection.columns(unit_terms(t)) for t in beside),
            ]
        )
    versions = [
        *by_change.items(),
        *((HYSTERESIS, columns) for columns in _plays(projection, every)),
    ]
    return [
        Flexible(words, parts)
        for words, columns in versions
        if columns.shape[1] and (parts := projection.parts_of(_lively(columns)))
    ]


def _columns(
    projection: Projection, amplitudes: Sequence[Sequence[Term]], weights: Sequence[Weight]
) -> FloatArray:
    """Lay terms out over all rows, weighted in each way; shape (n, amplitudes · weights)."""
    columns = np.zeros((len(projection.rows), len(amplitudes) * len(weights)))
    for j, terms in enumerate(amplitudes):
        for term in terms:
            view, errors = projection.errors(term)
            for w, weight in enumerate(weights):
                columns[view.rows, j * len(weights) + w] += errors * weight(term, view)
    return np.nan_to_num(columns, nan=0.0)


def _lively(columns: FloatArray) -> FloatArray:
    """Leave out what shows nowhere."""
    return columns[:, columns.any(axis=0)]


def _powers() -> list[Weight]:
    return [partial(_power, m) for m in range(1, POWERS_ALONG + 1)]


def _power(exponent: int, _: Term, view: View) -> FloatArray:
    """Give a power of the position, scaled from −1 to 1 over where it was measured."""
    at = view.places.positions_mm
    low, high = np.nanmin(at, initial=np.inf), np.nanmax(at, initial=-np.inf)
    if not high > low:
        return np.zeros(at.shape)
    power: FloatArray = ((2.0 * at - low - high) / (high - low)) ** exponent
    return power


def _of_driver(projection: Projection, terms: Sequence[Term]) -> list[Weight]:
    """Powers of the driver, of its largest size; none of one that never changes."""
    if all(isinstance(term.driver, Always) for term in terms):
        return []
    values = [term.driver.at(projection.view(term.component).conditions) for term in terms]
    largest = max(float(np.nanmax(np.abs(v), initial=0.0)) for v in values) or 1.0
    return [partial(_driver_power, largest, exponent) for exponent in (1, 2)]


def _driver_power(largest: float, exponent: int, term: Term, view: View) -> FloatArray:
    power: FloatArray = (term.driver.at(view.conditions) / largest) ** exponent
    return power


def _plays(projection: Projection, terms: Sequence[Term]) -> Iterator[FloatArray]:
    """Let the component follow its sensor with play, of one width at a time.

    Beside it is the temperature itself: how much of the play the maps hold is not known. A reversal
    and what never changes are not what a hysteresis looks like.
    """
    codes = {term.component for term in terms}
    is_moving = not all(isinstance(term.driver, Always) or term.is_reversing for term in terms)
    located = projection.model.find(min(codes)) if len(codes) == 1 and is_moving else None
    if located is None:
        return
    view = projection.view(min(codes))
    sensor, conditions = located[0].sensor, view.conditions
    temperatures_c = conditions.temperature(sensor)
    known_c = temperatures_c[np.isfinite(temperatures_c)]
    range_k = float(np.ptp(known_c)) if known_c.size else 0.0
    shapes = [np.ones(len(view.rows)), np.nan_to_num(_power(1, terms[0], view))]
    for share in HALF_WIDTHS if range_k > 0.0 else ():
        played_c = conditions.lags.played(
            Signal("temperature", sensor), share * range_k, conditions.times_s
        )
        behind_k = played_c - temperatures_c
        if np.isfinite(behind_k).any():
            courses = [
                np.nan_to_num(course - np.nanmean(course)) for course in (behind_k, temperatures_c)
            ]
            columns = np.zeros((len(projection.rows), len(courses) * len(shapes)))
            columns[view.rows] = np.column_stack(
                [view.gains * course * shape for course in courses for shape in shapes]
            )
            yield columns


def _waves(projection: Projection) -> list[Weight]:
    times_s = projection.conditions.times_s
    began_s, lasted_s = float(times_s.min()), float(np.ptp(times_s)) or 1.0
    return [partial(_wave, began_s, lasted_s / k) for k in range(1, TIME_WAVES + 1)]


def _wave(began_s: float, half_period_s: float, _: Term, view: View) -> FloatArray:
    wave: FloatArray = np.cos(np.pi * (view.conditions.times_s - began_s) / half_period_s)
    return wave


def _stretches(projection: Projection) -> list[Weight]:
    """One for each stretch of time: visits, or blocks of long ones, as many together as are due."""
    number = np.unique(projection.rows.block, return_inverse=True)[1]
    count = int(number.max(initial=-1)) + 1
    stretches = min(count, STRETCHES)
    if stretches < FEWEST_STRETCHES:
        return []
    stretch = number * stretches // count
    return [partial(_in_stretch, stretch == s) for s in range(stretches)]


def _in_stretch(stretch: BoolArray, _: Term, view: View) -> FloatArray:
    return stretch[view.rows].astype(float)


def _by_component(terms: Sequence[Term]) -> list[Weight]:
    codes = list(dict.fromkeys(term.component for term in terms))
    return [partial(_of_component, code) for code in codes] if len(codes) > 1 else []


def _of_component(code: str, term: Term, view: View) -> FloatArray:
    return np.full(len(view.rows), float(term.component == code))


def _offset(projection: Projection, terms: Sequence[Term]) -> FloatArray:
    """A constant of each component, and one along its axis."""
    columns = np.zeros((len(projection.rows), 0))
    for shapes in _constants(terms):
        columns = np.hstack([columns, projection.columns([[term] for term in shapes])])
    return np.nan_to_num(columns, nan=0.0)


def _constants(terms: Sequence[Term]) -> Iterator[list[Term]]:
    if all(isinstance(term.driver, Always) for term in terms):
        return
    for code in dict.fromkeys(term.component for term in terms):
        of_component = [term for term in terms if term.component == code]
        shapes: dict[Shape, None] = dict.fromkeys(
            [Everywhere(), *(t.shape for t in of_component if isinstance(t.shape, OfPosition))]
        )
        yield [Term(code, Always(), shape) for shape in shapes]
