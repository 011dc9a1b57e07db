"""How much set-ups resemble each other, and whether what all have the same is more than that.

Set-ups that are made anew each time scatter about nothing, and many of them average out. The same
person with the same warm laser makes each much like the one before: eight of them may then be
worth one or two, and what they have in common looks like a map that no longer holds. How long
they remember is one number for all that an instrument measures, so that all channels tell it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np
from scipy.special import logsumexp

from app.arrays import BoolArray, FloatArray, IntArray
from app.search.levels import NEGLIGIBLE, Fits, fitted
from app.search.priors import LASTING_SIZES, MEMORIES, ODD
from app.search.scatter import FEWEST_SETUPS

MOST_LEVELS: Final = 50
"""Neighbouring set-ups are taken together where there are more: only what lasts matters."""

HALF: Final = 0.5
"""Share of a term's squares from which it does harm if they are none of the machine's."""


def _sizes(memory: float) -> list[tuple[float, float]]:
    return list(product(LASTING_SIZES, LASTING_SIZES[1:] if memory else (0.0,)))


AS_LIKELY_NONE: Final = np.concatenate(
    [
        np.full(len(_sizes(m)), np.log(0.5 / len(_sizes(m)) / (len(MEMORIES) - 1 if m else 1)))
        for m in MEMORIES
    ]
)
"""Where nothing is known it is as likely that set-ups remember nothing (log probability)."""


_MEMORY, _LASTING = np.array([(m, lasts) for m in MEMORIES for _, lasts in _sizes(m)]).T


@dataclass(frozen=True, eq=False)
class Alike:
    """How much set-ups resemble each other, by what all channels show together.

    Parameters
    ----------
    probability : ndarray, shape (g,)
        Of each memory and size, in the order of `set_ups_seen`.
    is_likely
        Whether they more probably remember than not, whichever channel is left out: what one alone
        shows may be an effect in it.
    """

    probability: FloatArray
    is_likely: bool

    def drawn(
        self,
        unit: FloatArray,
        setups: IntArray,
        variance: FloatArray,
        random: np.random.Generator,
        uniform: FloatArray,
    ) -> FloatArray:
        """Let unit draws of independent set-ups resemble each other.

        What lasts is as large as the channels together show, and no larger where a channel scatters
        more: what it has for itself may be an effect, which such draws would then hide.

        Parameters
        ----------
        unit : ndarray, shape (b, s, m)
            Of b set-ups, m draws of each of their s shapes.
        setups : ndarray, shape (b,)
            Numbers of the set-ups, all different.
        variance : ndarray, shape (m,)
            How much the channel's set-ups shift in each draw, in repeatabilities squared.
        random
            Source of what lasts, of this channel.
        uniform : ndarray, shape (m,)
            Which memory and size a draw has, from 0 to 1: one instrument measures all channels.
        """
        ends = np.cumsum(self.probability)
        which = np.searchsorted(ends, uniform * ends[-1]).clip(max=len(ends) - 1)
        # Of a set-up's variance a share is what lasts and the rest its own, √share and √(1 − share)
        # of unit draws: together it is as large as the channel shows.
        square = _LASTING[which] ** 2
        share = np.divide(square, variance, out=np.ones_like(square), where=square < variance)
        apart = np.abs(np.subtract.outer(setups, setups))
        lasting = random.standard_normal(unit.shape)
        for memory in MEMORIES[1:]:
            of_memory = _MEMORY[which] == memory
            # L times independent unit draws are correlated as L Lᵀ.
            root = np.linalg.cholesky(np.exp(-apart / memory))
            lasting[..., of_memory] = np.tensordot(root, lasting[..., of_memory], axes=1)
        share = np.where(_MEMORY[which] > 0.0, share, 0.0)
        return np.sqrt(1.0 - share) * unit + np.sqrt(share) * lasting


def how_alike(seen: Sequence[FloatArray]) -> Alike:
    """Put together what channels show (`set_ups_seen`)."""
    without = (_together([*seen[:i], *seen[i + 1 :]]) for i in range(len(seen)))
    remember = [_probability(likelihood)[_MEMORY > 0.0].sum() for likelihood in without]
    return Alike(_probability(_together(seen)), min(remember, default=0.0) > HALF)


def set_ups_seen(residuals: FloatArray, visit: IntArray) -> FloatArray:
    """Say how likely each memory and size makes the levels that one channel's set-ups have.

    A few set-ups say little of their memory, but how far from zero they are.

    Parameters
    ----------
    residuals : ndarray, shape (n,)
        Residuals beside all terms, in repeatabilities.
    visit : ndarray, shape (n,)
        Numbers of their set-ups, growing with time.

    Returns
    -------
    ndarray, shape (g,)
        Log likelihoods, in the order of `MEMORIES` and of the sizes tried for each.
    """
    levels = _levels(residuals, np.ones(len(residuals)), visit)
    return np.concatenate([_fits(levels, m).about_zero for m in MEMORIES])


def evidence_beside_alike(
    residuals: FloatArray,
    contribution: FloatArray,
    tilt: FloatArray,
    visit: IntArray,
    is_free: BoolArray,
    others: Sequence[FloatArray] = (),
) -> float | None:
    """Say how much speaks for a standing term where set-ups may resemble each other.

    A set-up shifts and tilts a channel. What the term has of either is looked at by itself: its
    levels, one for each set-up, are something common, an independent scatter, and one that fades
    from set-up to set-up, whose variances and memory are integrated over. What the other channels
    show of these is expected here, unless this channel is one of the few that are unlike them.

    Parameters
    ----------
    residuals : ndarray, shape (n,)
        Residuals of one channel beside all terms, in repeatabilities.
    contribution : ndarray, shape (n,)
        What the term explains of them.
    tilt : ndarray, shape (n, q)
        Columns along which a set-up may tilt.
    visit : ndarray, shape (n,)
        Numbers of their set-ups, growing with time.
    is_free : ndarray, shape (n,)
        Whether the zero of its set-up is not known: no shift is then seen.
    others
        `set_ups_seen` of the other channels.

    Returns
    -------
    float or None
        Twice the log likelihood ratio for what they have in common, that at least half of the
        term's squares have: if these are none of the machine's, adopting all makes things worse.
        None: fewer than four set-ups say nothing.

    Examples
    --------
    >>> visit, tilt = np.repeat(np.arange(8), 6), np.tile(np.linspace(-1.0, 1.0, 6), 8)[:, None]
    >>> noise, known = np.random.default_rng(1).normal(size=48), np.zeros(48, dtype=bool)
    >>> evidence_beside_alike(noise, np.full(48, 3.0), tilt, visit, known) > 10.0
    True
    >>> fading = np.array([0.0, 0.6, 0.9, 1.5, 1.7, 1.4, 0.7, 0.2])[visit] - 0.9
    >>> evidence_beside_alike(fading + 0.2 * noise, np.full(48, 1.5), tilt, visit, known) < 10.0
    True
    """
    expected = _expected(others)
    centred = tilt - tilt.mean(axis=0)
    # What is the same at all places tilts nowhere.
    along = centred @ np.linalg.lstsq(centred, contribution, rcond=None)[0]
    shift = (
        np.zeros(len(contribution))
        if is_free.any()
        else np.full(len(contribution), contribution.mean())
    )
    rest = contribution - contribution.mean() - along
    judged = [
        (float(part @ part), evidence)
        for part, course in ((shift, shift), (along, _within(along, visit)))
        if np.abs(course).max() > NEGLIGIBLE * np.abs(contribution).max()
        and (evidence := _evidence(residuals, part, course, visit, expected)) is not None
    ]
    return _median([*judged, (float(rest @ rest), np.inf)]) if judged else None


def _median(parts: Sequence[tuple[float, float]]) -> float:
    """Give the evidence that half of the squares do not exceed."""
    half = HALF * sum(square for square, _ in parts)
    reached = 0.0
    for square, evidence in sorted(parts, key=lambda part: part[1]):
        reached += square
        if reached > half:
            return evidence
    return np.inf


def _evidence(
    residuals: FloatArray,
    part: FloatArray,
    course: FloatArray,
    visit: IntArray,
    expected: FloatArray,
) -> float | None:
    """Say how much speaks for one part, its levels being seen along a course."""
    levels = _levels(residuals + part, course, visit)
    if len(levels) < FEWEST_SETUPS:
        return None
    fits = [_fits(levels, m) for m in MEMORIES]
    common, nothing = (
        np.concatenate(each)
        for each in zip(*[(fit.log, fit.about_zero) for fit in fits], strict=True)
    )
    return 2.0 * float(logsumexp(common + expected) - logsumexp(nothing + expected))


def _expected(others: Sequence[FloatArray]) -> FloatArray:
    """Say how probable each memory and size is (log), by what the other channels show together.

    One instrument and one hand set up all of them: most have the same, a few are odd ones.
    """
    if not others:
        return AS_LIKELY_NONE
    likelihood = _together(others)
    # With the probability ODD it is unlike the others, which then say nothing of it.
    expected_log: FloatArray = np.logaddexp(
        np.log1p(-ODD) + likelihood - logsumexp(likelihood), np.log(ODD) + AS_LIKELY_NONE
    )
    return expected_log


def _probability(log: FloatArray) -> FloatArray:
    return np.asarray(np.exp(log - logsumexp(log)))


def _together(seen: Sequence[FloatArray]) -> FloatArray:
    """Give the log posterior of each memory and size, but for a constant."""
    if not seen:
        return AS_LIKELY_NONE
    log = np.array(seen)
    of_any = logsumexp(log + AS_LIKELY_NONE, axis=1, keepdims=True)
    of_each: FloatArray = np.logaddexp(np.log1p(-ODD) + log, np.log(ODD) + of_any)
    total: FloatArray = of_each.sum(axis=0) + AS_LIKELY_NONE
    return total


def _levels(values: FloatArray, course: FloatArray, visit: IntArray) -> FloatArray:
    """Give each set-up's size along a course, in its largest sizes, and its variance; (m, 3).

    The third is the set-up's number: a channel that shows in every seventh alone tells of set-ups
    that are seven apart.
    """
    groups = np.array_split(np.unique(visit), min(len(np.unique(visit)), MOST_LEVELS))
    largest = float(np.abs(course).max())
    levels = []
    for group in groups:
        here = np.isin(visit, group)
        square = float(course[here] @ course[here]) / largest
        if square > 0.0:
            # Least squares along the course c give v·c/(c·c) of it: the level is as much as that
            # makes where c is largest, and its variance largest²/(c·c).
            level = float(values[here] @ course[here]) / square
            levels.append((level, largest / square, float(np.mean(group))))
    return np.array(levels).reshape(-1, 3)


def _within(course: FloatArray, visit: IntArray) -> FloatArray:
    """Take each set-up's mean off: what is left of a tilt, its shift beside it."""
    within = course.copy()
    for number in np.unique(visit):
        within[visit == number] -= course[visit == number].mean()
    return within


def _fits(levels: FloatArray, memory: float) -> Fits:
    """Fit what levels have in common, at each size of their scatter and of what lasts."""
    level, variance, number = levels.T
    apart = np.abs(np.subtract.outer(number, number))
    lasting = np.exp(-apart / memory) if memory else np.zeros_like(apart, dtype=float)
    scatter, lasts = np.square(_sizes(memory)).T[..., None, None]
    covariances = np.diag(variance) + scatter * np.eye(len(level)) + lasts * lasting
    return fitted(level, np.ones((len(level), 1)), covariances)
