"""The whole search repeated without each fold of visits: honest figures, slopes, recurrence.

M. Stone, J. R. Stat. Soc. B 36 (1974) 111: cross-validation.
C. Ambroise, G. McLachlan, Proc. Natl. Acad. Sci. 99 (2002) 6562: the choice of terms is
repeated within every fold; else held-out figures are too good.
J. Copas, J. R. Stat. Soc. B 45 (1983) 311: slope of what is seen on what was predicted.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray
from app.search.findings import Rival, Slope, Status
from app.search.foresight import Learned, calibration_slope, learn, slope_from_same_zero
from app.search.library import Library
from app.search.model import Model
from app.search.problem import Problem, Term
from app.search.rivals import claims_less
from app.search.selection import Selection, Selector, given_states
from app.search.splits import Splits

ABOVE_ZERO: Final = 2.33
"""Standard errors that a slope must lie above 0: one per cent, one-sided."""

AROUND_ONE: Final = 3.0
"""Standard errors within which a slope must lie around 1."""

LEAST_RATIO: Final = 10.0
"""Likelihood ratio on all visits below which no fold would choose an entry."""

ALIKE: Final = 1e-9
"""Share of themselves by which columns that are the same differ."""

OFTEN_FOUND: Final = 0.5
ON_FEW_VISITS: Final = 0.8
"""Leverage from which leaving out a fold may leave nothing to find."""

Rivals = Sequence[Sequence[tuple[Rival, Term]]]
"""For each term, its rivals."""


@dataclass(eq=False)
class Validation:
    """What held-out visits say.

    Parameters
    ----------
    after, adopted : ndarray, shape (n,)
        Predicted part of each of the caller's rows, in repeatabilities; nan: not held out.
        `after` has the terms and refitted maps, `adopted` the terms alone.
    known : ndarray, shape (n,)
        The same of the terms that the model has already.
    apart : ndarray, shape (terms, n)
        The same of what stands for each term; 0 where nothing does.
    variance : ndarray, shape (n,)
        Of `after`, by what the visits that taught it leave open of terms and maps.
    fold : ndarray of int, shape (n,)
        Which fold held a row out; -1: none.
    found_in
        For each term, the folds that found it again.
    forward
        For each term, the slope on the last visits; None: not found on the earlier ones.
    """

    after: FloatArray
    adopted: FloatArray
    known: FloatArray
    apart: FloatArray
    variance: FloatArray
    fold: IntArray
    slopes: list[list[Slope]]
    found_in: list[set[int]]
    folds: int
    forward: list[Slope | None] = field(default_factory=list)

    def slope(self, number: int) -> Slope | None:
        """Pool a term's slopes, each by its information."""
        slopes = self.slopes[number]
        information = sum(s.information for s in slopes)
        if information <= 0:
            return None
        value = sum(s.value * s.information for s in slopes) / information
        return Slope(value, information**-0.5, information)

    def inclusion(self, number: int) -> float | None:
        """Give the share of folds that found a term again."""
        return len(self.slopes[number]) / self.folds if self.folds else None

    def confirms(self, number: int) -> bool:
        """Say whether held-out visits show a term as large as predicted, found again often."""
        slope = self.slope(number)
        often = (self.inclusion(number) or 0.0) >= OFTEN_FOUND
        return often and slope is not None and bool(holds(slope, np.inf))

    def settled(self, terms: Sequence[Term], doubts: Sequence[Collection[str]]) -> set[int]:
        """List the channels in which terms act and all of these terms are sure.

        Parameters
        ----------
        doubts
            For each term, how the values depart from it.
        """
        sure = [not doubt and self.confirms(i) for i, doubt in enumerate(doubts)]
        acting = {c for term in terms for c in term.channels}
        pairs = zip(terms, sure, strict=True)
        return acting - {c for term, is_sure in pairs if not is_sure for c in term.channels}

    def where_found(
        self, terms: Sequence[Term], channels: Collection[int], channel: IntArray
    ) -> Validation:
        """Leave out, in some channels, the folds that have missed a term that acts there.

        The whole effect is left of what was held out then: that says how few visits teach it,
        and nothing of what it does not explain.

        Parameters
        ----------
        channel : ndarray of int, shape (n,)
            Each row's channel.
        """
        after = self.after.copy()
        for term, folds in zip(terms, self.found_in, strict=True):
            its_channels = list({*term.channels}.intersection(channels))
            after[np.isin(channel, its_channels) & ~np.isin(self.fold, list(folds))] = np.nan
        return replace(self, after=after)


def validate(
    library: Library,
    splits: Splits,
    main: Selection,
    allowed: BoolArray,
    rivals: Rivals,
    step: Callable[[float], None],
) -> Validation:
    """Hold out every fold in turn, and the last visits where a term is a trend.

    Thresholds are those of the whole campaign: the library is the same.

    Parameters
    ----------
    allowed : ndarray, shape (entries,)
        Which entries may be chosen.
    rivals
        For each term, its rivals: a fold that finds a tied one has found the same thing.
    """
    n = len(library.problem.rows.values)
    validation = Validation(
        after=np.full(n, np.nan),
        adopted=np.full(n, np.nan),
        known=np.full(n, np.nan),
        apart=np.zeros((len(main.terms), n)),
        variance=np.full(n, np.nan),
        fold=np.full(n, -1),
        slopes=[[] for _ in main.terms],
        found_in=[set() for _ in main.terms],
        folds=splits.folds,
    )
    library = _near(library, main)
    for fold in range(splits.folds):
        step(fold / (splits.folds + 1))
        held_out = splits.fold(fold)
        teaching = splits.teaching(fold)
        learned = _learned(library, teaching, main, allowed, rivals)
        matches = _matches(learned.terms, main.terms, rivals)
        learned = _as_all_say(library.problem, learned, matches, main.terms, teaching)
        for number, match in enumerate(matches):
            if match is not None:
                slope = _slope(library.problem, learned, match, main.terms[number], held_out)
                validation.slopes[number].append(slope)
                validation.found_in[number].add(fold)
        open_in = _open(learned)
        for c, state in learned.states.items():
            channel = state.fixed.channel
            mine = held_out[channel.cells][channel.block]
            validation.fold[channel.rows[mine]] = fold
            validation.variance[channel.rows[mine]] = open_in[c][mine]
            validation.after[channel.rows[mine]] = learned.prediction(c)[mine]
            validation.adopted[channel.rows[mine]] = learned.effect(c)[mine]
            validation.known[channel.rows[mine]] = learned.effect(c, known_alone=True)[mine]
            for number, match in enumerate(matches):
                if match is not None:
                    part = learned.effect(c, number=match)[mine]
                    validation.apart[number, channel.rows[mine]] = part
    validation.forward = _forward(library, splits, main, allowed, rivals)
    return validation


def status_of(
    slope: Slope | None,
    forward: Slope | None,
    inclusion: float | None,
    evidence: float,
    leverage: float,
) -> Status:
    """Judge a term by what held-out visits show of it.

    Parameters
    ----------
    slope
        Pooled over the folds; None: never found again.
    inclusion
        Share of folds that found it again; None: there were no folds.
    evidence
        Its likelihood ratio: how well its size itself is known.
    leverage
        Share of its evidence on two visits.

    Examples
    --------
    >>> status_of(Slope(0.95, 0.1, 100.0), None, 1.0, 120.0, 0.2)
    <Status.CONFIRMED: 'confirmed'>
    >>> status_of(Slope(0.1, 0.1, 100.0), None, 1.0, 120.0, 0.2)
    <Status.SUSPECTED: 'suspected'>
    >>> status_of(Slope(0.0, 1.0, 1.0), None, 1.0, 120.0, 0.2)
    <Status.NOT_CONFIRMABLE: 'not-confirmable'>
    """
    if slope is None or slope.information < ABOVE_ZERO**2:
        excited = inclusion is not None and slope is None and leverage < ON_FEW_VISITS
        return Status.SUSPECTED if excited else Status.NOT_CONFIRMABLE
    judged = [slope]
    if forward is not None and forward.information >= ABOVE_ZERO**2:
        judged.append(forward)
    is_stable = all(holds(s, evidence) for s in judged) and (inclusion or 0.0) >= OFTEN_FOUND
    return Status.CONFIRMED if is_stable else Status.SUSPECTED


def holds(slope: Slope, evidence: float) -> bool:
    """Whether held-out visits show a term, about as large as predicted."""
    # The prediction's own size is uncertain too: 1/√LR is its relative standard error.
    error = np.sqrt(slope.error**2 + 1.0 / max(evidence, 1.0))
    return slope.value > ABOVE_ZERO * slope.error and abs(slope.value - 1.0) < AROUND_ONE * error


def _near(library: Library, main: Selection) -> Library:
    """Keep the entries that a part of the visits could ever choose.

    What falls short by far on all visits does not pass a threshold on fewer.
    """
    largest = np.max([stage.ratio for stage in main.stages], axis=0)
    return library.take(largest >= LEAST_RATIO)


def _learned(
    library: Library, train: BoolArray, main: Selection, allowed: BoolArray, rivals: Rivals
) -> Learned:
    if not main.terms:
        return learn(library.problem.states(train), [])
    adopted = [term for term in main.terms if term.origin is not None]
    count = len(main.terms) - len(adopted)
    selector = Selector(library, train, allowed, 0.0, count, adopted)
    stages = main.stages
    if any(term.candidate.of_setups for term in main.terms):
        # What all visits show of the instrument need not show in a part of them again.
        stages = [replace(stage, alike=None) for stage in stages]
    terms = selector.select(None, stages).terms
    return learn(selector.states, _as_stated(library.problem, terms, main.terms, rivals))


def _as_stated(
    problem: Problem, terms: Sequence[Term], wanted: Sequence[Term], rivals: Rivals
) -> list[Term]:
    """State of two that begin alike the one that all visits together state, as it is adopted."""
    renamed = {
        rival.key: term
        for term, rivals_of_term in zip(wanted, rivals, strict=True)
        for rival, other in rivals_of_term
        if rival.tied and claims_less(term, other)
    }
    keys = {term.candidate.key for term in terms}
    return [
        problem.term(renamed[key].candidate, term.theta)
        if (key := term.candidate.key) in renamed and renamed[key].candidate.key not in keys
        else term
        for term in terms
    ]


def _as_all_say(
    problem: Problem,
    learned: Learned,
    matches: Sequence[int | None],
    wanted: Sequence[Term],
    train: BoolArray,
) -> Learned:
    """Take of all visits which of the nonlinear parameters it is that some cannot tell apart.

    Of a change that came while nobody taught, every moment in between is as good: when it came is
    nothing that could be foretold, and at another moment its size could not be seen.
    """
    terms = list(learned.terms)
    for term, match in zip(wanted, matches, strict=True):
        if match is None or terms[match].candidate.key != term.candidate.key:
            continue
        # A part of the visits need not have all channels, nor a shape in all of them.
        if terms[match].theta == term.theta or terms[match].columns.keys() != term.columns.keys():
            continue
        # As large as these visits say that it is: other sizes have other columns.
        moved = problem.term(term.candidate, term.theta, terms[match].about)
        after = {c: moved.columns[c] * moved.norms for c in term.columns}
        expected = {c: terms[match].columns[c] * terms[match].norms for c in term.columns}
        taught = {c: problem.fixed[c].channel for c in term.columns}
        rows = {c: train[channel.cells][channel.block] for c, channel in taught.items()}
        if all(
            np.allclose(after[c][rows[c]], expected[c][rows[c]], rtol=ALIKE, atol=0.0)
            for c in expected
        ):
            columns = {c: after[c] / terms[match].norms for c in after}
            terms[match] = replace(terms[match], theta=term.theta, columns=columns, _moments={})
    return replace(learned, terms=terms)


def _open(learned: Learned) -> dict[int, FloatArray]:
    """Give the variance that teaching leaves in every row of each channel, shape (n,) each.

    In repeatabilities. Maps and terms of one channel are known as it knows them; amplitudes that
    channels share, within their joint standard errors.
    """
    fit = learned.fit
    return {
        c: fit.scatter[c] * Model(state, fit.level[c]).open_still
        for c, state in given_states(learned.states, learned.terms).items()
    }


def _matches(terms: Sequence[Term], wanted: Sequence[Term], rivals: Rivals) -> list[int | None]:
    """Find the terms that a fold found in the place of each term; none serves for two."""
    tied = [{rival.key for rival, _ in rivals_of_term if rival.tied} for rivals_of_term in rivals]
    pairs = sorted(
        (unlikeness, i, number)
        for number, term in enumerate(wanted)
        for i, other in enumerate(terms)
        if (unlikeness := _unlikeness(other, term, tied[number])) is not None
    )
    matches: list[int | None] = [None] * len(wanted)
    for _, i, number in pairs:
        if matches[number] is None and i not in matches:
            matches[number] = i
    return matches


def _unlikeness(other: Term, term: Term, tied: Collection[str]) -> tuple[int, float] | None:
    """Order what may stand for a term: itself, by its nonlinear parameter, then ties, then kin."""
    if other.candidate.key == term.candidate.key:
        return 0, abs((other.theta or 0.0) - (term.theta or 0.0))
    if other.candidate.key in tied:
        return 1, 0.0
    near = set(other.columns) & set(term.columns)
    return (2, 0.0) if near and other.candidate.family == term.candidate.family else None


def _slope(
    problem: Problem, learned: Learned, match: int, wanted: Term, held_out: BoolArray
) -> Slope:
    """Ask held-out visits how much of a term there is, by what they know of their zero."""
    keeps_zero = wanted.candidate.keeps_zero and learned.terms[match].candidate.keeps_zero
    slope = slope_from_same_zero if keeps_zero else calibration_slope
    return slope(problem, learned, match, held_out)


def _forward(
    library: Library, splits: Splits, main: Selection, allowed: BoolArray, rivals: Rivals
) -> list[Slope | None]:
    """Ask the last visits whether trends are as large there as those before say."""
    if splits.folds < 2 or not any(t.candidate.trending for t in main.terms):
        return [None] * len(main.terms)
    late = splits.late()
    learned = _learned(library, ~late, main, allowed, rivals)
    matches = _matches(learned.terms, main.terms, rivals)
    return [
        _slope(library.problem, learned, match, term, late)
        if match is not None and term.candidate.trending
        else None
        for term, match in zip(main.terms, matches, strict=True)
    ]
