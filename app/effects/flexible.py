"""Flexible versions of a hypothesis: what it would be if its shape were only roughly right.

An effect that the library does not have is often imitated by one that it has: a bow by a profile
that comes and goes, a gradient with an offset by a late speed. Where the name is right, none of
these versions explains anything; one that does says that the name stands for something else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Final, TypeAlias

import numpy as np

from app.arrays import FloatArray
from app.effects.conditions import Signal
from app.effects.driver import Always
from app.effects.projection import Projection, View
from app.effects.shape import Everywhere, OfPosition, Shape
from app.effects.term import Term
from app.search.candidate import OFFSET, Flexible

Weights: TypeAlias = Callable[[Term, View], FloatArray]
"""Gives for a term the factors, shape (m, w), of the rows in which it shows."""

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
        "it varies differently along the axis": _columns(projection, first, _powers_along),
        "it depends differently on its driver": _columns(
            projection, amplitudes, _powers_of_driver(projection, every)
        ),
        OVER_TIME: _columns(projection, amplitudes, _of_rows(_waves(projection.rows.times_s))),
        "its size changes from visit to visit": _columns(
            projection, first, _of_rows(_stretches(projection))
        ),
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
        # What shows nowhere is left out.
        if columns.any() and (parts := projection.parts_of(columns[:, columns.any(axis=0)]))
    ]


def _columns(
    projection: Projection, amplitudes: Sequence[Sequence[Term]], weigh: Weights
) -> FloatArray:
    """Lay terms out over all rows, weighted in each way; shape (n, amplitudes · weights)."""
    by_amplitude = []
    for terms in amplitudes:
        columns = np.zeros((len(projection.rows), 0))
        for term in terms:
            view, errors = projection.errors(term)
            weighted = errors[:, None] * weigh(term, view)
            columns = columns if columns.size else np.zeros((len(columns), weighted.shape[1]))
            columns[view.rows] += weighted
        by_amplitude.append(columns)
    return np.nan_to_num(np.hstack(by_amplitude), nan=0.0)


def _of_rows(weights: FloatArray) -> Weights:
    """Weigh rows, shape (n, w), whatever the term."""
    return lambda _, view: weights[view.rows]


def _powers_along(_: Term, view: View) -> FloatArray:
    """Powers of the position, scaled from −1 to 1 over where it was measured."""
    at = view.places.positions_mm
    low, high = np.nanmin(at, initial=np.inf), np.nanmax(at, initial=-np.inf)
    scaled = (2.0 * at - low - high) / (high - low) if high > low else np.zeros(at.shape)
    return np.asarray(scaled[:, None] ** np.arange(1, POWERS_ALONG + 1))


def _powers_of_driver(projection: Projection, terms: Sequence[Term]) -> Weights:
    """Weigh with the driver over its largest size, and the square; none of one that never changes.

    That is a constant, of which another size is no other version.
    """
    values = [term.driver.at(projection.view(term.component).conditions) for term in terms]
    largest = max(float(np.nanmax(np.abs(v), initial=0.0)) for v in values) or 1.0
    powers = [] if all(isinstance(term.driver, Always) for term in terms) else [1.0, 2.0]
    return lambda term, view: (term.driver.at(view.conditions) / largest)[:, None] ** powers


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
    shapes = [np.ones(len(view.rows)), np.nan_to_num(_powers_along(terms[0], view)[:, 0])]
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


def _waves(times_s: FloatArray) -> FloatArray:
    """Cosines over the time of the campaign, shape (n, waves)."""
    share = (times_s - times_s.min()) / (float(np.ptp(times_s)) or 1.0)
    return np.asarray(np.cos(np.pi * share[:, None] * np.arange(1, TIME_WAVES + 1)))


def _stretches(projection: Projection) -> FloatArray:
    """Which rows are of each stretch: visits, or blocks of long ones, as many together as are due.

    Shape (n, stretches); none where there are too few.
    """
    number = np.unique(projection.rows.block, return_inverse=True)[1]
    count = int(number.max(initial=-1)) + 1
    stretches = min(count, STRETCHES)
    each = np.arange(stretches if stretches >= FEWEST_STRETCHES else 0)
    return np.asarray(number[:, None] * stretches // count == each, dtype=float)


def _by_component(terms: Sequence[Term]) -> Weights:
    """Weigh each component by itself; none of one alone."""
    codes = np.array(list(dict.fromkeys(term.component for term in terms)))
    codes = codes if codes.size > 1 else codes[:0]
    return lambda term, view: np.tile(codes == term.component, (len(view.rows), 1)).astype(float)


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
