"""Whether so few set-ups, places or hours show an effect that it may be anything else."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.effects.driver import Always, SinceReference, StepAfter
from app.effects.effect import Effect
from app.effects.kind import OverTime
from app.effects.observations import POINT_CHANNELS
from app.effects.registry import kind_of
from app.effects.words import SURELY
from app.geometry.components import COMPONENTS
from app.identification.analysis.finished_search import FinishedSearch
from app.search.findings import FoundTerm
from app.search.rows import Datum
from app.search.scatter import FEWEST_SETUPS
from app.units import SECONDS_PER_DAY, SECONDS_PER_H

NOTICEABLE: Final = 0.05
"""Share of its largest size from which an effect shows in a visit."""

APART: Final = 1e-9
"""Share of an effect's information below which nothing tells it from what was always there."""

CHANGES: Final = 0.1
"""Share of an effect's squares from which it changes at its places."""

SPARE_PLACES: Final = 2
"""So many more places than unknowns."""

FEWEST_DAYS: Final = 4
ONE_HOUR_S: Final = 2.0 * SECONDS_PER_H
"""Within so much of every day, on so many days: then nothing is known of other hours."""


def is_of_few_places(finished: FinishedSearch, effect: Effect, term: FoundTerm) -> bool:
    """Whether an effect may be anything else, as it never changes at any of its few places.

    What changes with time or direction shows at one place. What is the same there always, shows
    by how places differ: where they are hardly more than what is unknown of it and of its set-up,
    whatever else differs from place to place looks the same, held-out moments included.
    """
    rows, size = finished.residuals.rows, finished.explained(effect)
    for c in term.channels:
        rows_of_channel = np.flatnonzero(finished.use & (finished.rows.channel == c))
        has_places = rows.channels[c] in POINT_CHANNELS or COMPONENTS[rows.channels[c]].axis
        if not has_places or not size[rows_of_channel].any():
            return False
        places = np.column_stack(
            [rows.points_mm[rows_of_channel], rows.tool_offsets_mm[rows_of_channel]]
        )
        place = np.unique(np.nan_to_num(places), axis=0, return_inverse=True)[1].ravel()
        counts = np.bincount(place)
        means = np.bincount(place, weights=size[rows_of_channel]) / counts
        if np.sum((size[rows_of_channel] - means[place]) ** 2) > CHANGES * np.sum(
            size[rows_of_channel] ** 2
        ):
            return False
        setups = np.unique(finished.rows.visit[rows_of_channel]).size
        zeros = {
            finished.rows.datum.get((int(v), c), Datum.ABSOLUTE)
            for v in finished.rows.visit[rows_of_channel]
        }
        unknown = term.degrees_of_freedom
        if setups < FEWEST_SETUPS:
            unknown += 1 + int((np.ptp(finished.rows.tilt[rows_of_channel], axis=0) > 0.0).sum())
        elif zeros != {Datum.ABSOLUTE}:
            unknown += 1
        if len(counts) >= unknown + SPARE_PLACES:
            return False
    return bool(term.channels)


def is_of_one_hour(finished: FinishedSearch, effect: Effect, term: FoundTerm) -> bool:
    """Whether what differs from a component's maps may be the hour of the day.

    Visits at one hour differ from maps of another by what has changed since, and by what goes with
    the hour. Where the maps were measured at that hour too, only the first is left.
    """
    rows_of_term = finished.use & np.isin(finished.rows.channel, term.channels)
    visited_s = finished.residuals.rows.times_s[rows_of_term]
    both_s = np.append(visited_s, finished.mapped_s(effect))
    return bool(hours_of_day(visited_s)) and not hours_of_day(both_s)


def hours_of_day(times_s: FloatArray) -> str:
    """Say between which hours of the day all times lie; empty if they tell of other hours too.

    >>> days = 86400.0 * np.arange(6.0)
    >>> hours_of_day(days + 34200.0 + 600.0 * np.arange(6.0))
    '09:30 and 10:20'
    >>> hours_of_day(days + 86000.0 - 500.0 * np.arange(6.0))
    '23:11 and 23:53'
    >>> hours_of_day(days + 7200.0 * np.arange(6.0)), hours_of_day(days[:3])
    ('', '')
    """
    if np.unique(times_s // SECONDS_PER_DAY).size < FEWEST_DAYS:
        return ""
    of_day = np.unique(times_s % SECONDS_PER_DAY)
    # On the circle of a day: all times lie in what the widest gap leaves of it, over midnight too.
    gaps = np.diff(np.append(of_day, of_day[0] + SECONDS_PER_DAY))
    widest = int(np.argmax(gaps))
    if SECONDS_PER_DAY - gaps[widest] > ONE_HOUR_S:
        return ""
    ends = of_day[(widest + 1) % of_day.size], of_day[widest]
    return " and ".join(
        f"{s // SECONDS_PER_H:02.0f}:{s % SECONDS_PER_H // 60.0:02.0f}" for s in ends
    )


def is_of_one_setup(finished: FinishedSearch, effect: Effect) -> bool:
    """Whether one set-up alone knows an effect that grows or begins with time.

    Its components by themselves may show it in several set-ups, or points. Where both were
    measured, points count only if they show it by themselves: an effect that one record of its
    component knows alone is only predicted there.
    """
    names = np.array(finished.residuals.rows.channels)[finished.rows.channel]
    itself = finished.use & np.isin(names, effect.components)
    if _is_in_several(finished, effect, itself):
        return False
    always = _had_it_always_been(finished, effect)
    points = finished.use & np.isin(names, POINT_CHANNELS) & (always != 0.0)
    if not _is_in_several(finished, effect, points):
        return True
    return bool(itself.any()) and not _is_shown(finished, effect, always, points)


def _is_in_several(finished: FinishedSearch, effect: Effect, acts: BoolArray) -> bool:
    """Whether it shows in two set-ups at least; where it begins, in two before it too.

    Parameters
    ----------
    acts : ndarray, shape (n,)
        Rows in which it shows, or would had it begun before.
    """
    size = np.abs(finished.explained(effect))
    after = acts & (size > NOTICEABLE * size[acts].max(initial=0.0))
    grows = kind_of(effect.kind).over_time is OverTime.GROWS
    sides = [acts] if grows else [after, acts & ~after]
    return all(len(np.unique(finished.rows.visit[side])) > 1 for side in sides)


def _had_it_always_been(finished: FinishedSearch, effect: Effect) -> FloatArray:
    """Say what an effect of time would be had it always been the same, shape (n,)."""
    terms = (
        replace(term, driver=Always())
        if isinstance(term.driver, SinceReference | StepAfter)
        else term
        for term in effect.terms
    )
    return finished.explained(replace(effect, terms=tuple(terms)))


def _is_shown(
    finished: FinishedSearch, effect: Effect, always: FloatArray, acts: BoolArray
) -> bool:
    """Whether some rows show by themselves that an effect came, as large as it is said to be.

    What was there all the time, such as a map that is wrong, is fitted beside it: generalised
    least squares, with the scatter of observations and of set-ups.

    Parameters
    ----------
    always : ndarray, shape (n,)
        What it would be had it always been the same.
    acts : ndarray, shape (n,)
        These rows.
    """
    contribution = finished.explained(effect)
    others = sum((finished.explained(e) for e in finished.effects()), -contribution)
    columns = np.column_stack([finished.from_zero(part, acts) for part in (contribution, always)])
    residuals = finished.from_zero(finished.rows.values - others, acts)
    noise, shift = finished.scatters[acts].T[..., None]
    group = finished.set_up[acts]
    # V⁻¹ = (1 − k 11ᵀ) / noise², with the set-up's shift in common.
    shared = shift**2 / (noise**2 + np.bincount(group)[group][:, None] * shift**2)
    sums = np.zeros((int(group.max(initial=0)) + 1, 2))
    np.add.at(sums, group, columns)
    weighted = (columns - shared * sums[group]) / noise**2
    information, product = weighted.T @ columns, weighted.T @ residuals
    covariance = np.linalg.pinv(information, hermitian=True)
    # Where nothing tells the two apart, neither is known.
    if information[0, 1] ** 2 >= (1.0 - APART) * information[0, 0] * information[1, 1]:
        return False
    share, error = float(covariance[0] @ product), float(np.sqrt(covariance[0, 0]))
    return share > SURELY * error and abs(share - 1.0) <= SURELY * error
