"""The ranges in which a found effect was learnt, read off the rows that it was estimated from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.effects.effect import Effect
from app.effects.projection import Projection, View
from app.effects.shape import Places
from app.effects.term import Term
from app.effects.valid import Range, Valid, range_of
from app.geometry.components import COMPONENTS
from app.units import SECONDS_PER_DAY

SURELY: Final = 2.0
"""Standard errors by which a growth may be larger than it was found."""

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
    valid = Valid(
        from_s=float(times_s.min()),
        to_s=float(times_s.max()),
        temperatures_c=_ranges(
            {s: [v.conditions.temperature(s) for v in views.values()] for s in sorted(sensors)}
        ),
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


def use_until_s(
    valid: Valid,
    amplitudes: Sequence[Sequence[Term]],
    coefficients: FloatArray,
    covariance: FloatArray,
    projection: Projection,
    noise: Mapping[int, float],
) -> float | None:
    """Say until when what a growing effect adds is still below the scatter of an observation.

    Parameters
    ----------
    valid
        The ranges in which it was learnt.
    amplitudes
        For each of k amplitudes its terms, with coefficient 1.
    coefficients, covariance : ndarray, shape (k,) and (k, k)
        What was found.
    noise
        Channel to the standard deviation of one observation.

    Returns
    -------
    float, or None [s]
        The time at which |growth| and two of its standard errors, since `valid.to_s` and where
        along the axis it is largest, reach one standard deviation; None where nothing grows.
    """
    growing = {t.component for ts in amplitudes for t in ts if t.driver.grows_with_time}
    found = []
    for code in growing:
        along = _along(amplitudes, code, projection, valid)
        spread = np.sqrt(np.einsum("ij,jk,ik->i", along, covariance, along))
        per_day = float(np.max(np.abs(along @ coefficients) + SURELY * spread))
        found += [s / (gain * per_day) for s, gain in _scatter(projection, code, noise) if per_day]
    if not found:
        return None
    return valid.to_s + min(min(found) * SECONDS_PER_DAY, LONGEST_S)


def _along(
    amplitudes: Sequence[Sequence[Term]], code: str, projection: Projection, valid: Valid
) -> FloatArray:
    """Give what one unit of each amplitude grows by a day at both ends, shape (2, k)."""
    edges = valid.edges_mm(code) or (np.nan, np.nan)
    places = Places(np.array(edges), np.zeros(2))
    moment = projection.conditions.take(np.zeros(2, dtype=np.intp))
    one = np.ones(2)
    found = np.zeros((2, len(amplitudes)))
    for j, terms in enumerate(amplitudes):
        for term in terms:
            if term.component == code and term.driver.grows_with_time:
                found[:, j] += term.coefficient * term.shape.along(
                    projection.model, code, places, moment, one
                )
    return found


def _scatter(
    projection: Projection, code: str, noise: Mapping[int, float]
) -> list[tuple[float, float]]:
    """List scatter and largest gain of the channels that show a component: its own alone if any."""
    view = projection.view(code)
    names, channel = projection.rows.channels, projection.rows.channel[view.rows]
    shown = [n for n in view.channels if n in noise]
    own = [n for n in shown if names[n] in COMPONENTS]
    return [(noise[n], float(np.abs(view.gains[channel == n]).max())) for n in own or shown]


def _used(view: View, use: BoolArray) -> View:
    own = np.flatnonzero(use[view.rows])
    return View(
        view.rows[own],
        view.channels,
        view.gains[own],
        Places(view.places.positions_mm[own], view.places.directions[own]),
        view.conditions.take(own),
    )


def _with_range(term: Term, view: View | None) -> Term:
    if view is None or not term.driver.signals or term.driver.holds_itself:
        return term
    return replace(term, learnt=range_of(term.driver.at(view.conditions)))


def _ranges(values: Mapping[str, Sequence[FloatArray]]) -> dict[str, Range]:
    found = {name: range_of(np.concatenate(own)) for name, own in values.items()}
    return {name: learnt for name, learnt in found.items() if learnt is not None}
