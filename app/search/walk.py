"""Whether what grows or begins with time is more than a zero that walks from set-up to set-up.

Set-ups that scatter independently average out, and a small trend of their levels is soon sure.
Levels that add up, each a little off the one before, make trends and steps by themselves, and
held-out visits between the others confirm them. Both happen: a laser is set up anew each time, an
inductive sensor's zero or a foundation stays where it went.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Final

import numpy as np
from scipy.special import ndtr, softmax

from app.arrays import FloatArray, IntArray
from app.search.levels import NEGLIGIBLE, Fits, expected_beside, fitted
from app.search.priors import WALK_SIZES
from app.search.scatter import FEWEST_SETUPS

CHANCE: Final = 0.002
"""How improbable the opposite sign of a trend must be, walks of every size considered."""

MOST_LEVELS: Final = 100
"""Neighbouring set-ups are taken together where there are more: only slow changes matter."""

SIZES_TRIED: Final = tuple(product(WALK_SIZES, WALK_SIZES))
"""Standard deviations of a set-up, and of a step of the walk, in repeatabilities."""

_WEIGHTS: Final = np.array([1.0 if step else len(WALK_SIZES) - 1.0 for _, step in SIZES_TRIED])
AS_LIKELY_NONE: Final = _WEIGHTS / _WEIGHTS.sum()
"""Where nothing is known of a walk it is as likely that there is none: set-ups are made anew."""


def walk_seen(residuals: FloatArray, visit: IntArray) -> FloatArray | None:
    """Say how probable one channel makes each size of scatter and of walk.

    Parameters
    ----------
    residuals : ndarray, shape (n,)
        Residuals beside all terms, in repeatabilities.
    visit : ndarray, shape (n,)
        Numbers of their set-ups, growing with time.

    Returns
    -------
    ndarray or None
        Probabilities that add up to one. None: fewer than four set-ups say nothing.
    """
    levels = _levels(residuals, np.zeros(len(residuals)), visit)
    if len(levels) < FEWEST_SETUPS:
        return None
    return softmax(_fits(levels, np.ones((len(levels), 1))).restricted)


def may_be_walk(
    residuals: FloatArray,
    contribution: FloatArray,
    visit: IntArray,
    others: Sequence[FloatArray] = (),
) -> bool | None:
    """Judge whether a walk over set-ups leaves the sign of a term open.

    Levels of set-ups are a constant, the term at a free size, an independent scatter of set-ups,
    and a random walk, whose variances are integrated over (restricted likelihood). One instrument
    measures all channels: what the others show of its walk is expected here, and anything else
    is as probable as that one channel is unlike all others.

    Parameters
    ----------
    residuals : ndarray, shape (n,)
        Residuals of one channel beside all other terms, in repeatabilities.
    contribution : ndarray, shape (n,)
        What the term explains of them.
    visit : ndarray, shape (n,)
        Numbers of their set-ups, growing with time.
    others
        `walk_seen` of the other channels.

    Returns
    -------
    bool or None
        None: fewer than four set-ups, or all with as much of the term, say nothing.

    Examples
    --------
    >>> visit = np.repeat(np.arange(20), 5)
    >>> drift = 0.4 * visit
    >>> noise = np.random.default_rng(1).normal(size=100)
    >>> may_be_walk(drift + noise, drift, visit)
    False
    >>> walk = np.cumsum(np.random.default_rng(2).normal(size=20))[visit]
    >>> slope = visit * (walk @ visit) / (visit @ visit)
    >>> may_be_walk(walk + noise, slope, visit)
    True
    """
    levels = _levels(residuals, contribution, visit)
    if len(levels) < FEWEST_SETUPS or np.ptp(levels[:, 1]) <= 0.0:
        return None
    fits = _fits(levels, np.column_stack([levels[:, 1], np.ones(len(levels))]))
    weights = softmax(fits.restricted + np.log(expected_beside(others, AS_LIKELY_NONE)))
    surely = fits.sizes[:, 0] / np.sqrt(fits.covariance[:, 0, 0])
    return float(weights @ ndtr(-surely)) > CHANCE


def _fits(levels: FloatArray, design: FloatArray) -> Fits:
    """Fit levels, shape (m, 4), at each size of scatter and walk."""
    level, _, count, number = levels.T
    steps = 1.0 + number - number[0]
    # Two levels of a walk have in common all steps up to the earlier one. A set-up that is missing
    # has had its step too.
    walk = np.minimum(steps[:, None], steps[None, :])
    scatter, step = np.square(SIZES_TRIED).T[..., None, None]
    return fitted(level, design, np.diag(1.0 / count) + scatter * np.eye(len(level)) + step * walk)


def _levels(residuals: FloatArray, contribution: FloatArray, visit: IntArray) -> FloatArray:
    """Give each set-up's level, the term's share of it, its observations, and its number, (m, 4).

    Along the term's own course over the places; where it is nothing, the plain mean. The zero
    walks in set-ups too in which the channel does not show.
    """
    sign = 1.0 if contribution.sum() >= 0.0 else -1.0
    nothing = NEGLIGIBLE * float(np.abs(contribution).max(initial=0.0))
    numbers = np.unique(visit)
    groups = np.array_split(numbers, min(len(numbers), MOST_LEVELS))
    level_rows = []
    for group in groups:
        here = np.isin(visit, group)
        count, number = float(here.sum()), float(np.mean(group))
        size = float(np.linalg.norm(contribution[here]))
        if size <= nothing * np.sqrt(count):
            level_rows.append((sign * float(residuals[here].mean()), 0.0, count, number))
        else:
            along = float(residuals[here] @ contribution[here]) / size
            level_rows.append((along / np.sqrt(count), size / np.sqrt(count), count, number))
    return np.array(level_rows)
