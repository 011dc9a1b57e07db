"""Which terms are real: the best first, refined, exchanged for rivals, the weak taken out.

The threshold decides whether anything is there at all, the evidence which of many it is.

G. Schwarz, Ann. Statist. 6 (1978) 461: approximation of the evidence.
J. Chen, Z. Chen, Biometrika 95 (2008) 759: its prior in large sets of candidates.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from scipy.special import chdtrc

from app.arrays import BoolArray, FloatArray
from app.search.base_grams import BaseGrams
from app.search.candidate import OFFSET, Candidate, Part
from app.search.draws import Draws
from app.search.joint_fit import Fit, fit_terms, unexpected
from app.search.library import Library
from app.search.problem import Term, places
from app.search.refinement import refine
from app.search.same_course import second_late, taken_back
from app.search.scan import Scan, scan
from app.search.state import Given, State
from app.search.threshold import Threshold, threshold

WORTH_A_SWAP: Final = 2.0
"""Twice the log evidence that a rival must be better by to take a term's place."""

NEAR: Final = 0.1
"""Correlation of two terms' amplitudes from which one is looked at again when the other moves."""

CHANCE_COURSE: Final = 0.05
"""Probability by which noise shows a course beside a constant. What resembling set-ups have in
common passes the threshold in one campaign of several: so it is named in one of a hundred."""

EXCHANGES: Final = 3
FINALISTS: Final = 6
"""So many of the best are refined before one is picked: the grid must not decide."""

GRID_MARGIN: Final = 40.0
"""A coarse grid may hide so much evidence,"""

GRID_SHARE: Final = 0.5
"""and so much of it again in share: at a time of change that is half a step of the grid off, some
of the rows have the whole effect where there is none."""


@dataclass(frozen=True, eq=False)
class Stage:
    """One scan's threshold, what it found, and which entries it could test.

    `alike` is the threshold where set-ups resemble each other, if `limit` judges what set-ups do
    themselves as if they were made anew; `is_level` says which of these may be no more than what
    set-ups that resemble each other have in common.
    """

    limit: Threshold
    global_p: float
    ratio: FloatArray
    rank: FloatArray
    is_level: BoolArray
    alike: Threshold | None = None


@dataclass(eq=False)
class Selection:
    """Terms chosen, and how it came to them."""

    terms: list[Term]
    stages: list[Stage] = field(default_factory=list)
    is_cut: bool = False
    """Whether one more passed, and was not taken because there are so many already."""


def _continue() -> None:
    """Let the work go on."""


@dataclass(eq=False)
class Selector:
    """Chooses terms on some cells of visits.

    Parameters
    ----------
    cells : ndarray, shape (cells,)
        Which cells take part.
    allowed : ndarray, shape (entries,)
        Which entries may be chosen.
    known
        Terms that the model has already: fitted beside what is chosen, never exchanged, and taken
        out where they no longer pay.
    made_anew
        The threshold where set-ups are made anew each time: it goes on to judge what set-ups do
        themselves, of which then more than a constant must be seen. None: it judges everything.
    step
        Called between parts of the work; may raise to stop.
    """

    library: Library
    cells: BoolArray
    allowed: BoolArray
    false_alarm: float
    most_terms: int
    known: Sequence[Term] = ()
    made_anew: Threshold | None = None
    step: Callable[[], None] = _continue

    def __post_init__(self) -> None:
        self._last: tuple[tuple[object, ...], list[Term], Scan] | None = None
        self._bare: tuple[dict[int, State], Scan] | None = None
        self.states = self.library.problem.states(self.cells)
        self.base = BaseGrams(self.library, self.states)
        candidates = self.library.candidates
        self.groups = self.library.groups
        self.families = self.library.families
        flags = [(c.expected is not None, c.bounds is not None, c.of_setups) for c in candidates]
        of_entries = np.array(flags, dtype=np.bool_).reshape(-1, 3)[self.groups]
        self.is_expected, self.is_sampled, self.are_of_setups = of_entries.T
        self.penalty = penalties(self.library, sum(s.count for s in self.states.values()))

    def select(self, draws: Draws | None, stages: Sequence[Stage] = ()) -> Selection:
        """Choose terms.

        Parameters
        ----------
        draws
            Draws of noise for the threshold; it serves for all stages, as the library is the
            same and what terms take of its freedom is little.
        stages
            Without draws: stages of another selection whose threshold is used.
        """
        chosen = Selection(self._still_paying(list(self.known)))
        while True:
            self.step()
            scanned = self.scan(chosen.terms, None if chosen.stages else draws)
            stage = self._stage(scanned, [*chosen.stages, *stages], chosen.terms)
            chosen.stages.append(stage)
            term = self._best(scanned, stage, chosen.terms)
            if term is None:
                return chosen
            before = _new(chosen.terms)
            if before >= self.most_terms:
                chosen.is_cut = True
                return chosen
            rounds = 1 if draws is None else EXCHANGES
            chosen.terms = self._settled([*chosen.terms, term], rounds)
            # What came in pushed out another: a further round would go in circles.
            if _new(chosen.terms) <= before:
                return chosen

    def scan(
        self, terms: Sequence[Term], draws: Draws | None = None, generic: bool = False
    ) -> Scan:
        """Scan entries beside given terms."""
        if self._bare is not None and not terms and not generic and draws is None:
            return self._bare[1]
        key = (tuple(id(t) for t in terms), draws, generic)
        if self._last is None or self._last[0] != key:
            before = None if generic or draws else self._bare
            scanned = scan(self.library, self.given(terms), self.base, draws, generic, before)
            self._last = (key, list(terms), scanned)
            if not terms and not generic:
                self._bare = (self.states, scanned)
        return self._last[2]

    def given(self, terms: Sequence[Term]) -> dict[int, State]:
        """Put terms into the channels' models on these cells."""
        return given_states(self.states, terms)

    def fit(self, terms: Sequence[Term]) -> Fit:
        """Fit terms on these cells."""
        return fit_terms(self.states, terms)

    def evidence(self, term: Term, others: Sequence[Term], base: float | None = None) -> float:
        """Give 2 ln B of a term against its absence, the prior spread inside its family.

        Parameters
        ----------
        base
            Log likelihood of the others alone, where it is known.
        """
        before = self.fit(others).log_likelihood if base is None else base
        fit = self.fit([*others, term])
        rise = 2.0 * (fit.log_likelihood - before)
        return rise - self.cost(term, fit, len(fit.amplitudes) - term.size)

    def cost(self, term: Term, fit: Fit, place: int) -> float:
        """Give what a term costs on the scale of twice the log likelihood.

        Parameters
        ----------
        fit, place
            A fit of it, and where its amplitudes begin there.
        """
        return self.price(term) + unexpected(term, fit, place)

    def price(self, term: Term) -> float:
        """Give what a term costs whatever its size: its parameters, and its family's prior."""
        same = self.groups == self.library.candidates.index(term.candidate)
        return float(self.penalty[same][0])

    def odds_of_family(self, term: Term) -> float:
        """Give what a term costs for being one of so many of its family: 2 ln of their number."""
        family = self.families[self.groups == self.library.candidates.index(term.candidate)][0]
        return 2.0 * float(np.log(np.count_nonzero(self.families == family)))

    def refined(self, term: Term, others: Sequence[Term]) -> Term:
        """Refine a term's nonlinear parameter on these cells."""
        return refine(self.library.problem, self.states, term, others)

    def _stage(self, scanned: Scan, stages: Sequence[Stage], others: Sequence[Term]) -> Stage:
        alike = None
        if scanned.noise.shape[1]:  # draws, even where the library is empty
            tested = scanned.only(self.allowed)
            halves = self.library.problem.has_expected_wander
            limit = threshold(tested, self.groups, self.families, self.false_alarm, halves)
            if self.made_anew is not None:
                alike, limit = limit, limit.except_for(self.are_of_setups, self.made_anew)
        else:
            limit, alike = stages[0].limit, stages[0].alike
        is_level = self._are_levels(scanned, limit, alike, others)
        # Tables have errors, and residuals contain them: a few per cent of what a mistake would do
        # surprise, and are none. A scan does not see whether an amplitude is as it should be.
        p = limit.global_p(scanned.only(self.allowed & ~self.is_expected & ~is_level))
        return Stage(limit, p, scanned.ratio, scanned.rank, is_level, alike)

    def _best(self, scanned: Scan, stage: Stage, others: Sequence[Term]) -> Term | None:
        """Pick by evidence among those that pass the threshold and beat no effect at all."""
        # The correction may lower the evidence, never raise it: it comes from few draws.
        factor = np.minimum(stage.limit.bartlett, 1.0)
        score = scanned.ratio * factor - self.penalty
        passed = self.beside(others) & ~stage.is_level & (stage.limit.excess(scanned) >= 0)
        best = self._best_beside(np.where(passed & (score > 0), score, -np.inf), others)
        if best is None:
            return None
        # A scan does not see whether an amplitude is what it is expected to be.
        is_right = best.candidate.expected is None or self.evidence(best, others) > 0
        return best if is_right else None

    def _are_levels(
        self, scanned: Scan, limit: Threshold, alike: Threshold | None, others: Sequence[Term]
    ) -> BoolArray:
        """Say which entries may be what set-ups that resemble each other have in common.

        They have it without any cause, and what settles within minutes is nearly a constant: its
        course within the set-ups must show too. One instrument measures all channels, so one that
        shows it is enough.
        """
        if alike is None or any(term.candidate.of_setups for term in others):
            return np.zeros_like(self.allowed)
        passed = self.beside(others) & (limit.excess(scanned) >= 0)
        is_open = np.asarray(passed & self.are_of_setups & (alike.excess(scanned) < 0))
        is_known = any(
            self._has_course(self.library.term(entry), others)
            for entry in np.flatnonzero(is_open).tolist()
        )
        return np.zeros_like(is_open) if is_known else is_open

    def _has_course(self, term: Term, others: Sequence[Term]) -> bool:
        """Whether a term is seen beside a constant of its channels, and as it is without one."""
        beside = [*others, *self._constants(term)]
        before, alone, both = (self.fit(t) for t in (beside, [*others, term], [*beside, term]))
        is_same = alone.amplitudes[-term.size :] @ both.amplitudes[-term.size :] > 0.0
        rise = 2.0 * (both.log_likelihood - before.log_likelihood)
        return bool(is_same and 0.5 * chdtrc(term.size, rise) < CHANCE_COURSE)

    def _constants(self, term: Term) -> list[Term]:
        """Make a constant for each channel in which a term acts."""
        problem = self.library.problem
        rows = {c: problem.fixed[c].channel.rows for c in term.channels}
        parts = [Part(c, row, np.ones((len(row), 1))) for c, row in rows.items()]
        return [problem.term(Candidate.of_parts(OFFSET, OFFSET, [part]), None) for part in parts]

    def beside(self, others: Sequence[Term]) -> BoolArray:
        """Say which entries may be chosen beside others, shape (entries,)."""
        return self.allowed & ~second_late(self.library, others)

    def _best_beside(self, score: FloatArray, others: Sequence[Term]) -> Term | None:
        """Give the best that neither takes an amplitude of another back nor has its own taken."""
        while np.isfinite(score).any():
            best = self.finalist(score, others)
            if not taken_back(self.states, [*others, best]):
                return best
            best_candidate = self.library.candidates.index(best.candidate)
            score = np.where(self.groups == best_candidate, -np.inf, score)
        return None

    def finalist(self, score: FloatArray, others: Sequence[Term]) -> Term:
        """Refine the best entry of each of the best candidates; give the best of them.

        Parameters
        ----------
        score : ndarray, shape (entries,)
            2 ln B of every entry, −∞: not allowed.
        """
        # Apart: with the amplitude free, one that is expected looks better than it is, and would
        # push others out; what looks worse than these all the same need not be refined.
        free, bound = (
            np.where(scores, score, -np.inf) for scores in (~self.is_expected, self.is_expected)
        )
        top = float((free if np.isfinite(free).any() else bound).max())
        floor = top - 10.0 - 0.1 * abs(top)
        each = (best_entries(scores, self.groups, floor)[:FINALISTS] for scores in (free, bound))
        hidden = self._hidden(score, top)
        entries = list(dict.fromkeys([*(entry for scores in each for entry in scores), *hidden]))
        base = self.fit(others).log_likelihood
        terms = [self.refined(self.library.term(i), others) for i in entries]
        return max(terms, key=lambda t: self.evidence(t, others, base))

    def _hidden(self, score: FloatArray, top: float) -> list[int]:
        """List the best entry of each family that may be ahead of all others between grid values.

        Only what was sampled too coarsely: the best of a family without a nonlinear parameter is
        what its scan says it is.
        """
        floor = top - GRID_MARGIN - GRID_SHARE * abs(top)
        return best_entries(np.where(self.is_sampled, score, -np.inf), self.families, floor)

    def _settled(self, terms: list[Term], rounds: int) -> list[Term]:
        """Refine again, exchange, and take out what no longer pays."""
        if len(terms) == 1:
            return terms
        moved = [len(terms) - 1]
        for i in self._near(terms, moved):
            terms[i] = self.refined(terms[i], terms[:i] + terms[i + 1 :])
        for _ in range(rounds):
            self.step()
            moved = self._exchange(terms, moved)
            if not moved:
                break
        return self._without_weak(terms)

    def _still_paying(self, terms: list[Term]) -> list[Term]:
        """Fit the known terms' nonlinear parameters in turn, and take out what no longer pays."""
        for i in range(len(terms)):
            terms[i] = self.refined(terms[i], terms[:i] + terms[i + 1 :])
        return self._without_weak(terms)

    def _without_weak(self, terms: list[Term]) -> list[Term]:
        """Take out what does not pay beside the others.

        The latest first: of two that explain the same, the one found earlier stays.
        """
        for i in reversed(range(len(terms))):
            others = terms[:i] + terms[i + 1 :]
            lone = not others and terms[i].origin is None  # it passed the threshold just now
            if not lone and self.evidence(terms[i], others) < 0:
                terms = others
        while back := taken_back(self.states, terms):
            terms = [term for i, term in enumerate(terms) if i != back[-1]]
        return terms

    def _exchange(self, terms: list[Term], moved: Sequence[int]) -> list[int]:
        """Try the best rival in the place of each term that is near to what moved.

        Returns
        -------
        list of int
            Places where a rival came in.
        """
        changed: list[int] = []
        for i in self._near(terms, moved):
            if terms[i].origin is not None:
                continue
            others = terms[:i] + terms[i + 1 :]
            score = self.scan(others).ratio - self.penalty
            best = self._best_beside(np.where(self.beside(others), score, -np.inf), others)
            if best is None:
                continue
            gain = self.evidence(best, others) - self.evidence(terms[i], others)
            # Below this a swap would follow the noise, and two equals could swap for ever.
            if best.candidate is not terms[i].candidate and gain > WORTH_A_SWAP:
                terms[i] = best
                changed.append(i)
        return changed

    def _near(self, terms: Sequence[Term], moved: Sequence[int]) -> list[int]:
        """List the terms whose amplitudes depend on those that moved, the newest aside.

        What does not share anything with them has been settled before, and stays as it is.
        """
        covariance = self.fit(terms).covariance
        sizes = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        correlation = np.abs(covariance / np.outer(sizes, sizes))
        of_term = np.repeat(np.arange(len(terms)), [t.size for t in terms])
        touched = correlation[:, np.isin(of_term, moved)].max(axis=1) > NEAR
        near = np.unique(of_term[touched])
        return [i for i in near.tolist() if i < len(terms) - 1 or i not in moved]


def _new(terms: Sequence[Term]) -> int:
    """Count the terms that the model does not have yet."""
    return sum(t.origin is None for t in terms)


def penalties(library: Library, count: int) -> FloatArray:
    """Give what each entry costs: its parameters, and its share of its family's prior.

    Returns
    -------
    ndarray, shape (entries,)
        (k + nonlinear) ln n + 2 ln(entries of the family): the Schwarz approximation of
        −2 ln B, with a family's prior spread evenly over its entries. An amplitude that is
        expected is no parameter.
    """
    groups, families = library.groups, library.families
    sizes = np.array([entry.size for entry in library.entries])
    is_free = np.array([not c.expected for c in library.candidates])[groups]
    nonlinear = np.array([c.nonlinear for c in library.candidates])[groups]
    spread = 2.0 * np.log(np.bincount(families)[families])
    return np.asarray((is_free * sizes + nonlinear) * np.log(max(count, 2)) + spread)


def best_entries(score: FloatArray, groups: np.ndarray, floor: float) -> list[int]:
    """List each candidate's best entry, best first, down to a floor.

    Parameters
    ----------
    score : ndarray, shape (entries,)
    groups : ndarray, shape (entries,)
        Each entry's candidate.

    Examples
    --------
    >>> best_entries(np.array([1.0, 5.0, 4.0, 0.0]), np.array([0, 0, 1, 2]), 0.5)
    [1, 2]
    """
    order = np.argsort(-score, kind="stable")
    seen: dict[int, int] = {}
    for i in order[score[order] >= floor].tolist():
        seen.setdefault(int(groups[i]), i)
    return list(seen.values())


def given_states(states: Mapping[int, State], terms: Sequence[Term]) -> dict[int, State]:
    """Put terms into the channels' models.

    A term on one channel is free there. A fingerprint's amplitudes are shared by
    channels, so they stand at their joint estimate, open within its standard error.

    Parameters
    ----------
    states
        Channel to state, without terms.
    """
    if not terms:
        return dict(states)
    fit = fit_terms(states, terms)
    errors = np.sqrt(np.maximum(np.diag(fit.covariance), 1e-30))
    conditioned = {c: _conditioned_on(s, c, terms, fit, errors) for c, s in states.items()}
    return {
        c: State(s.fixed, s.cells, conditioned[c]) if conditioned[c] else s
        for c, s in states.items()
    }


def _conditioned_on(
    state: State, channel: int, terms: Sequence[Term], fit: Fit, errors: FloatArray
) -> Given | None:
    columns, precision, offset = [], [], np.zeros(len(state.fixed.channel.rows))
    for term, part in zip(terms, places(terms), strict=True):
        if channel not in term.columns:
            continue
        columns.append(term.columns[channel])
        if len(term.columns) == 1:
            precision.append(np.zeros(term.size))
        else:
            precision.append(fit.scatter[channel] / errors[part] ** 2)
            offset = offset + term.columns[channel] @ fit.amplitudes[part]
    if not columns:
        return None
    return Given(np.hstack(columns), np.concatenate(precision), offset)
