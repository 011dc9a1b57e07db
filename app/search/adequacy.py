"""Whether something is left that no term explains.

N. Draper, H. Smith, Applied Regression Analysis (1998): lack of fit against pure error.
S. Self, K. Liang, J. Am. Stat. Assoc. 82 (1987) 605: likelihood ratios at a boundary.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from scipy.special import chdtrc, fdtrc

from app.arrays import BoolArray
from app.search.draws import Draws
from app.search.findings import FAR_OFF, HeldOut, Unexplained
from app.search.joint_fit import Fit
from app.search.noise import ENOUGH_REPLICATES, pure_error, repeatability
from app.search.priors import ASSUMED_SHIFT
from app.search.problem import Problem, Term
from app.search.rows import DeclaredNoise
from app.search.scan import Scan
from app.search.scatter import FEWEST_BLOCKS
from app.search.selection import Selector
from app.search.threshold import threshold

TESTS: Final = 4
"""So many tests share the false-alarm probability."""

OVER_FLOOR: Final = 1.3
"""Held-out RMS over the noise floor from which something is missing."""

OVER_FLOOR_AT_LEAST: Final = 1.15
"""So much of it must hold at the lower end of its interval: there are many components."""

TOO_MANY_OF_A_FAMILY: Final = 3
"""So many terms of one family on one channel imitate something unknown."""

USUAL_MULTIPLE: Final = 16.0
"""Multiple of the assumed variance up to which set-ups scatter: two repeatabilities."""

USUAL_WANDER: Final = USUAL_MULTIPLE * ASSUMED_SHIFT**2
"""Variance, in that of an observation, up to which they wander in time: as much."""

MOST_NAMED: Final = 3
"""So many quantities of the generic test are named."""


def adequacy(
    selector: Selector,
    terms: Sequence[Term],
    fit: Fit,
    use: BoolArray,
    draws: Draws,
    held_out: Mapping[int, HeldOut],
) -> list[Unexplained]:
    """Ask all tests whether something is left.

    Parameters
    ----------
    use : ndarray, shape (n,)
        Rows that take part.
    """
    problem, level = selector.library.problem, selector.false_alarm / TESTS
    return [
        *_generic(selector, terms, draws, level),
        *_lack_of_fit(problem, fit, use, level),
        *_far_off(selector, terms, level),
        *_above_floor(problem, use, held_out, level),
        *_imitation(terms),
    ]


def _generic(
    selector: Selector, terms: Sequence[Term], draws: Draws, level: float
) -> list[Unexplained]:
    """The largest of all smooth shapes, against its distribution under noise."""
    problem, entries = selector.library.problem, selector.library.entries
    candidates = selector.library.candidates
    generic = np.array([candidates[e.candidate].generic for e in entries])
    if not generic.any():
        return []
    scanned = selector.scan(terms, draws, generic=True)
    rank = scanned.rank * generic
    tested = Scan(scanned.ratio, scanned.noise, rank)
    together = np.zeros(len(rank), dtype=np.intp)
    halves = problem.has_expected_wander
    limit = threshold(tested, selector.groups, together, level, halves)
    excess = np.where(generic, limit.excess(tested), -np.inf)
    surprising = [i for i in np.argsort(-excess, kind="stable") if excess[i] >= 0]
    return [
        Unexplained("generic", channel, candidates[entries[i].candidate].key)
        for i in surprising[:MOST_NAMED]
        for channel in selector.library.term(int(i)).channels
    ]


def _lack_of_fit(problem: Problem, fit: Fit, use: BoolArray, level: float) -> list[Unexplained]:
    """What is left within visits, against what replicates differ by (F test)."""
    unexplained = []
    for c, fixed in problem.fixed.items():
        pure, freedom = pure_error(problem.rows, c, use)
        n = len(fixed.channel.rows)
        spent = fixed.channel.nuisance.shape[1] + len(fixed.channel.starts)
        if freedom < ENOUGH_REPLICATES or pure <= 0 or n - spent <= freedom:
            continue
        pure = max(pure, problem.rows.noise.get(c, DeclaredNoise()).rounding ** 2)
        # The fit's squares, maps and terms included; its pure error is taken off below.
        squares = fit.scatter[c] * fixed.channel.scale**2 * n
        ratio = (squares - pure * freedom) / max(n - freedom, 1) / pure
        p = float(fdtrc(n - spent - freedom, freedom, max(ratio, 0.0)))
        if p * len(problem.fixed) < level:
            unexplained.append(Unexplained("lack-of-fit", c, None))
    return unexplained


def _far_off(selector: Selector, terms: Sequence[Term], level: float) -> list[Unexplained]:
    """Few visits, further from the model than set-ups are: too few to say why."""
    few = {
        c: s
        for c, s in selector.given(terms).items()
        if len(s.fixed.channel.starts) < FEWEST_BLOCKS
    }
    unexplained = []
    for c, state in few.items():
        channel, null = state.fixed.channel, state.null - state.fixed.channel.prior
        usual = np.array(
            [
                max(t.shift, t.tilt) <= USUAL_MULTIPLE and t.wander <= USUAL_WANDER
                for t in channel.tried
            ]
        )
        ratio = 2.0 * float(null.max() - null[usual].max())
        if 0.5 * float(chdtrc(2.0, ratio)) * len(few) < level:
            unexplained.append(Unexplained(FAR_OFF, c, None))
    return unexplained


def _above_floor(
    problem: Problem, use: BoolArray, held_out: Mapping[int, HeldOut], level: float
) -> list[Unexplained]:
    """Held-out visits that are left far above what repeatability and set-ups leave.

    Either all visits are, so that any of them would be again, or what is left is no chance. What
    strikes now and then (a tool change, a pump) is in a few visits, and an interval over visits is
    then as wide as it is large; one visit alone may be a slip.
    """
    unexplained = []
    for c, h in held_out.items():
        if h.floor.total > 0 and h.visits >= FEWEST_BLOCKS:
            allowance = _allowance(problem, use, c)
            floor = h.floor.total * allowance
            is_in_all = h.after.low > OVER_FLOOR_AT_LEAST * floor
            is_no_chance = (
                h.spread > OVER_FLOOR * allowance
                and h.chance * len(held_out) < level
                # How far things wander nobody knows beforehand.
                and not problem.fixed[c].channel.blocks.may_wander
            )
            if h.after.rms > OVER_FLOOR * floor and (is_in_all or is_no_chance):
                unexplained.append(Unexplained("held-out", c, None))
    return unexplained


def _allowance(problem: Problem, use: BoolArray, channel: int) -> float:
    """How much too low a floor may be whose repeatability was only estimated (two sigma)."""
    measured = repeatability(problem.rows, channel, use)
    if measured.origin != "replicates":
        return 1.0
    _, freedom = pure_error(problem.rows, channel, use)
    return 1.0 + 2.0 / float(np.sqrt(2.0 * freedom))


def _imitation(terms: Sequence[Term]) -> list[Unexplained]:
    """Many terms on the same channels: of one family, or of several that each fit a little."""
    families = Counter((t.candidate.family, c) for t in terms for c in t.channels)
    places = Counter(t.channels for t in terms)
    twice = Counter((t.candidate.family, t.channels) for t in terms if t.candidate.only_once)
    return (
        [
            Unexplained("many-of-one-family", c, family)
            for (family, c), count in families.items()
            if count >= TOO_MANY_OF_A_FAMILY
        ]
        + [
            Unexplained("many-of-one-family", channels[0], family)
            for (family, channels), count in twice.items()
            if 1 < count < TOO_MANY_OF_A_FAMILY
        ]
        + [
            Unexplained("many-at-one-place", channels[0], None)
            for channels, count in places.items()
            if count >= TOO_MANY_OF_A_FAMILY
        ]
    )
