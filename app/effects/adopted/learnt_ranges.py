"""The ranges in which a found effect was learnt, read off the rows that it was estimated from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.effects.effect import Effect
from app.effects.projection import Projection, View
from app.effects.shape import Places
from app.effects.term import Term
from app.effects.valid import Range, Valid, range_of
from app.effects.words import TWO_ERRORS
from app.geometry.components import COMPONENTS
from app.units import SECONDS_PER_DAY

AGAIN: Final = 2.0 / 3.0
"""Share of the time in which a growth was observed for which it goes on afterwards. That it did was
tested by foretelling the last 0.3 from the first 0.7, 0.4 as long again; and one that has stopped
then leaves no more than two thirds of what it had come to."""

LONGEST_S: Final = 36_525.0 * SECONDS_PER_DAY
"""What hardly grows may be used for a hundred years [s]."""


def with_ranges(effect: Effect, projection: Projection, use: BoolArray) -> Effect:
    """Set beside an effect where it was learnt.

    Parameters
    ----------
    use : ndarray, shape (n,)
        Which of them took part.

    Returns
    -------
    Effect
        With `valid`, and with `learnt` at its terms; without where nothing shows it.
    """
    views = {code: _used(projection.view(code), use) for code in effect.components}
    views = {code: view for code, view in views.items() if view.rows.size}
    if not views:
        return effect
    times_s = np.concatenate([view.conditions.times_s for view in views.values()])
    signals = [
        signal for term in effect.terms for signal, tau in term.driver.signals if tau is None
    ]
    sensors = {s.name for s in signals if s.kind == "temperature"}
    sensors |= {s for term in effect.terms for s in term.sensors_of_tables(projection.model)}
    temperatures_c = _ranges(
        {s: [v.conditions.temperature(s) for v in views.values()] for s in sorted(sensors)}
    )
    valid = Valid(
        from_s=float(times_s.min()),
        to_s=float(times_s.max()),
        temperatures_c=temperatures_c | _until_maps(effect, temperatures_c),
        state=_ranges(
            {
                s.name: [v.conditions.state(s.name) for v in views.values()]
                for s in signals
                if s.kind == "state"
            }
        ),
        positions_mm=_ranges({code: [view.places.positions_mm] for code, view in views.items()}),
    )
    # An effect gives equal drivers one range: that of all components that they drive.
    terms = tuple(_with_range(term, views.get(term.component)) for term in effect.terms)
    return replace(effect, valid=valid, terms=terms)


class Growth(NamedTuple):
    """How fast one channel shows a growing effect, at an end of an axis, and what it scatters by.

    Parameters
    ----------
    per_day, error_per_day
        |growth| and its standard error [the component's unit each day].
    scatter
        One standard deviation of an observation [the component's unit].
    """

    per_day: float
    error_per_day: float
    scatter: float

    def days_after(self, continued_days: float) -> float:
        """Say how long after going on for so long its error reaches the scatter [days]."""
        # Solved for d: |growth| d + 2 σ (continued + d) = scatter. The growth counts from where it
        # may have stopped, its error from the last observation on.
        margin = self.scatter - TWO_ERRORS * self.error_per_day * continued_days
        return margin / max(self.per_day + TWO_ERRORS * self.error_per_day, np.finfo(float).tiny)


def growths(
    valid: Valid,
    amplitudes: Sequence[Sequence[Term]],
    coefficients: FloatArray,
    covariance: FloatArray,
    projection: Projection,
    noise: Mapping[int, float],
) -> list[Growth]:
    """Say how fast a growing effect grows, at both ends of each axis.

    Parameters
    ----------
    amplitudes
        For each of k amplitudes its terms, with coefficient 1.
    coefficients, covariance : ndarray, shape (k,) and (k, k)
    noise
        Channel to the standard deviation of one observation.

    Returns
    -------
    list of Growth
        Empty where nothing grows.
    """
    growing = {t.component for ts in amplitudes for t in ts if t.driver.grows_with_time}
    bounds = []
    for code in growing:
        along = _along(amplitudes, code, projection, valid)
        spread = np.sqrt(np.einsum("ij,jk,ik->i", along, covariance, along))
        bounds += [
            Growth(float(size), float(error), scatter / gain)
            for size, error in zip(np.abs(along @ coefficients), spread, strict=True)
            for scatter, gain in _scatter(projection, code, noise)
            if size + error > 0.0
        ]
    return bounds


def limited_in_time(valid: Valid, growing: Sequence[Growth], *, goes_on: bool = False) -> Valid:
    """Say until when a growing effect goes on, and until when it may be used.

    Parameters
    ----------
    goes_on
        Whether the last observations have shown what the earlier ones foretold: then it goes on
        for `AGAIN` of the time in which it was observed, as long as its error stays small.

    Returns
    -------
    Valid
        With the time at which what it may be wrong by reaches one standard deviation: two
        standard errors while it goes on, |growth| and two of its standard errors from then on,
        where along the axis that is largest. As it was where nothing grows.
    """
    if not growing:
        return valid
    days = 0.0
    if goes_on:
        days = AGAIN * (valid.to_s - valid.from_s) / SECONDS_PER_DAY
        days = min(
            [
                days,
                *(g.scatter / (TWO_ERRORS * g.error_per_day) for g in growing if g.error_per_day),
            ]
        )
    until_days = days + min(growth.days_after(days) for growth in growing)
    return replace(
        valid,
        use_until_s=valid.to_s + min(until_days * SECONDS_PER_DAY, LONGEST_S),
        continued_until_s=valid.to_s + days * SECONDS_PER_DAY if goes_on else None,
    )


def _along(
    amplitudes: Sequence[Sequence[Term]], code: str, projection: Projection, valid: Valid
) -> FloatArray:
    """Give what one unit of each amplitude grows by a day at both ends, shape (2, k)."""
    edges = valid.edges_mm(code) or (np.nan, np.nan)
    places = Places(np.array(edges), np.zeros(2))
    moment = projection.conditions.take(np.zeros(2, dtype=np.intp))
    ones = np.ones(2)
    columns = np.zeros((2, len(amplitudes)))
    for j, terms in enumerate(amplitudes):
        for term in terms:
            if term.component == code and term.driver.grows_with_time:
                columns[:, j] += term.coefficient * term.shape.along(
                    projection.model, code, places, moment, ones
                )
    return columns


def _scatter(
    projection: Projection, code: str, noise: Mapping[int, float]
) -> list[tuple[float, float]]:
    """List scatter and largest gain of the channels that show a component: its own alone if any."""
    view = projection.view(code)
    names, channel = projection.rows.channels, projection.rows.channel[view.rows]
    channels = [n for n in view.channels if n in noise]
    of_component = [n for n in channels if names[n] in COMPONENTS]
    return [
        (noise[n], float(np.abs(view.gains[channel == n]).max())) for n in of_component or channels
    ]


def _used(view: View, use: BoolArray) -> View:
    concerned = np.flatnonzero(use[view.rows])
    return View(
        view.rows[concerned],
        view.channels,
        view.gains[concerned],
        Places(view.places.positions_mm[concerned], view.places.directions[concerned]),
        view.conditions.take(concerned),
    )


def _with_range(term: Term, view: View | None) -> Term:
    if view is None or not term.driver.signals or term.driver.holds_itself:
        return term
    learnt = range_of(term.driver.at(view.conditions))
    return replace(term, learnt=None if learnt is None else term.driver.with_maps(learnt))


def _until_maps(effect: Effect, learnt_c: Mapping[str, Range]) -> dict[str, Range]:
    """Widen temperatures to those of maps at which a term is known to be zero."""
    return {
        signal.name: term.driver.until_maps(learnt_c[signal.name])
        for term in effect.terms
        if term.driver.is_held_by_signal
        for signal, _ in term.driver.signals
        if signal.kind == "temperature" and signal.name in learnt_c
    }


def _ranges(values: Mapping[str, Sequence[FloatArray]]) -> dict[str, Range]:
    ranges = {name: range_of(np.concatenate(parts)) for name, parts in values.items()}
    return {name: learnt for name, learnt in ranges.items() if learnt is not None}
