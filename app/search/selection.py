"""Which terms are real: the best first, refined, exchanged for rivals, the weak taken out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.search.base_grams import BaseGrams
from app.search.draws import Draws
from app.search.joint_fit import Fit, fit_terms
from app.search.library import Library
from app.search.problem import Term
from app.search.refinement import refine
from app.search.scan import Scan, scan
from app.search.state import Given, State
from app.search.threshold import Threshold, threshold

WORTH_A_SWAP: Final = 2.0
"""Twice the log evidence that a rival must be better by to take a term's place."""

EXCHANGES: Final = 3
FINALISTS: Final = 6
"""So many of the best are refined before one is picked: the grid must not decide."""


@dataclass(frozen=True, eq=False)
class Stage:
    """One scan's threshold, what it found, and which entries it could test."""

    limit: Threshold
    largest: float
    global_p: float
    ratio: FloatArray
    rank: FloatArray


@dataclass(eq=False)
class Selection:
    """Terms chosen, and how it came to them."""

    terms: list[Term]
    stages: list[Stage] = field(default_factory=list)


def _go_on() -> None:
    """Let the work go on."""


@dataclass(eq=False)
class Selector:
    """Chooses terms on some cells of visits.

    Parameters
    ----------
    library
        All entries.
    cells : ndarray, shape (cells,)
        Which cells take part.
    allowed : ndarray, shape (entries,)
        Which entries may be chosen.
    false_alarm
        Accepted probability of a false finding.
    most_terms
        Most terms.
    step
        Called between parts of the work; may raise to stop.
    """

    library: Library
    cells: BoolArray
    allowed: BoolArray
    false_alarm: float
    most_terms: int
    step: Callable[[], None] = _go_on

    def __post_init__(self) -> None:
        self._last: tuple[tuple[tuple[int, ...], bool, bool], list[Term], Scan] | None = None
        self._bare: tuple[dict[int, State], Scan] | None = None
        self.states = self.library.problem.states(self.cells)
        self.base = BaseGrams(self.library, self.states)
        self.groups = np.array([e.candidate for e in self.library.entries], dtype=np.intp)
        self.penalty = penalties(self.library, sum(s.count for s in self.states.values()))

    def select(self, draws: Draws | None, known: Sequence[Stage] = ()) -> Selection:
        """Choose terms.

        Parameters
        ----------
        draws
            Draws of noise for the threshold; it serves for all stages, as the library is the
            same and what terms take of its freedom is little.
        known
            Without draws: stages of another selection whose threshold is used.

        Returns
        -------
        Selection
        """
        chosen = Selection([])
        while True:
            self.step()
            found = self.scan(chosen.terms, None if chosen.stages else draws)
            stage = self._stage(found, [*chosen.stages, *known])
            chosen.stages.append(stage)
            if len(chosen.terms) >= self.most_terms:
                return chosen
            term = self._best(found, stage, chosen.terms)
            if term is None:
                return chosen
            before = len(chosen.terms)
            rounds = 1 if draws is None else EXCHANGES
            chosen.terms = self._settled([*chosen.terms, term], rounds)
            if len(chosen.terms) <= before:
                return chosen

    def scan(
        self, terms: Sequence[Term], draws: Draws | None = None, generic: bool = False
    ) -> Scan:
        """Scan entries beside given terms.

        Parameters
        ----------
        terms
            In the model already.
        draws
            Draws of noise, or None.
        generic
            Whether the generic entries are scanned, or all the others.

        Returns
        -------
        Scan
        """
        if self._bare is not None and not terms and not generic and draws is None:
            return self._bare[1]
        key = (tuple(id(t) for t in terms), draws is not None, generic)
        if self._last is None or self._last[0] != key:
            before = None if generic or draws else self._bare
            found = scan(self.library, self.given(terms), draws, generic, self.base, before)
            self._last = (key, list(terms), found)
            if not terms and not generic:
                self._bare = (self.states, found)
        return self._last[2]

    def given(self, terms: Sequence[Term]) -> dict[int, State]:
        """Put terms into the channels' models on these cells.

        Parameters
        ----------
        terms
            The terms.

        Returns
        -------
        dict
            Channel to state.
        """
        return given_states(self.states, terms)

    def fit(self, terms: Sequence[Term]) -> Fit:
        """Fit terms on these cells.

        Parameters
        ----------
        terms
            The terms.

        Returns
        -------
        Fit
        """
        return fit_terms(self.states, terms)

    def evidence(self, term: Term, others: Sequence[Term], base: float | None = None) -> float:
        """Give 2 ln B of a term against its absence, the prior spread inside its family.

        Parameters
        ----------
        term
            The term.
        others
            In the model beside it.
        base
            Log likelihood of the others alone, where it is known.
        """
        before = self.fit(others).log_likelihood if base is None else base
        rise = 2.0 * (self.fit([*others, term]).log_likelihood - before)
        return rise - self.cost(term)

    def cost(self, term: Term) -> float:
        """Give what a term costs on the scale of twice the log likelihood."""
        same = self.groups == self.library.candidates.index(term.candidate)
        return float(self.penalty[same][0])

    def refined(self, term: Term, others: Sequence[Term]) -> Term:
        """Refine a term's nonlinear parameter on these cells."""
        return refine(self.library.problem, self.states, term, others)

    def _stage(self, found: Scan, known: Sequence[Stage]) -> Stage:
        if found.noise.shape[1]:  # draws, even where the library is empty
            limit = threshold(_only(found, self.allowed), self.groups, self.false_alarm)
        else:
            limit = known[0].limit
        largest = float(np.max(limit.of(found) * self.allowed, initial=0.0))
        return Stage(limit, largest, limit.global_p(largest), found.ratio, found.rank)

    def _best(self, found: Scan, stage: Stage, others: Sequence[Term]) -> Term | None:
        """Pick by evidence among those that pass the threshold and beat no effect at all."""
        factor = np.minimum(stage.limit.bartlett, 1.0)
        score = found.ratio * factor - self.penalty
        passed = self.allowed & (stage.limit.of(found) >= stage.limit.surprise)
        score = np.where(passed, score, -np.inf)
        return self.finalist(score, others) if score.max(initial=-np.inf) > 0 else None

    def finalist(self, score: FloatArray, others: Sequence[Term]) -> Term:
        """Refine the best entry of each of the best candidates; give the best of them.

        Parameters
        ----------
        score : ndarray, shape (entries,)
            2 ln B of every entry, −∞: not allowed.
        others
            In the model already.

        Returns
        -------
        Term
        """
        top = float(score.max())
        entries = best_entries(score, self.groups, top - 10.0 - 0.1 * abs(top))[:FINALISTS]
        base = self.fit(others).log_likelihood
        terms = [self.refined(self.library.term(i), others) for i in entries]
        return max(terms, key=lambda t: self.evidence(t, others, base))

    def _settled(self, terms: list[Term], rounds: int) -> list[Term]:
        """Refine again, exchange, and take out what no longer pays."""
        if len(terms) == 1:
            return terms
        for i in range(len(terms) - 1):
            terms[i] = self.refined(terms[i], terms[:i] + terms[i + 1 :])
        for _ in range(rounds):
            self.step()
            if not self._exchange(terms):
                break
        for i in reversed(range(len(terms))):
            others = terms[:i] + terms[i + 1 :]
            if others and self.evidence(terms[i], others) < 0:
                terms = others
        return terms

    def _exchange(self, terms: list[Term]) -> bool:
        changed = False
        for i in range(len(terms)):
            others = terms[:i] + terms[i + 1 :]
            score = np.where(self.allowed, self.scan(others).ratio - self.penalty, -np.inf)
            best = self.finalist(score, others)
            gain = self.evidence(best, others) - self.evidence(terms[i], others)
            if best.candidate is not terms[i].candidate and gain > WORTH_A_SWAP:
                terms[i], changed = best, True
        return changed


def penalties(library: Library, count: int) -> FloatArray:
    """Give what each entry costs: its parameters, and its share of its family's prior.

    Parameters
    ----------
    library
        All entries.
    count
        How many rows take part.

    Returns
    -------
    ndarray, shape (entries,)
        (k + nonlinear) ln n + 2 ln(entries of the family): the Schwarz approximation of
        −2 ln B, with a family's prior spread evenly over its entries.
    """
    families = [library.candidates[e.candidate].family for e in library.entries]
    size = Counter(families)
    parameters = [e.size + library.candidates[e.candidate].nonlinear for e in library.entries]
    spread = 2.0 * np.log([size[f] for f in families])
    return np.asarray(np.array(parameters) * np.log(max(count, 2)) + spread)


def best_entries(score: FloatArray, groups: np.ndarray, floor: float) -> list[int]:
    """List each candidate's best entry, best first, down to a floor.

    Parameters
    ----------
    score : ndarray, shape (entries,)
    groups : ndarray, shape (entries,)
        Each entry's candidate.
    floor
        The least score.

    Returns
    -------
    list of int

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
    terms
        The terms.

    Returns
    -------
    dict
        Channel to state.
    """
    if not terms:
        return dict(states)
    fit = fit_terms(states, terms)
    errors = np.sqrt(np.maximum(np.diag(fit.covariance), 1e-30))
    given = {c: _given(s, c, terms, fit, errors) for c, s in states.items()}
    return {c: State(s.fixed, s.cells, given[c]) if given[c] else s for c, s in states.items()}


def _given(
    state: State, channel: int, terms: Sequence[Term], fit: Fit, errors: FloatArray
) -> Given | None:
    columns, precision, offset = [], [], np.zeros(len(state.fixed.channel.rows))
    start = 0
    for term in terms:
        part = slice(start, start + term.size)
        start += term.size
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


def _only(found: Scan, allowed: BoolArray) -> Scan:
    return Scan(found.ratio * allowed, found.noise * allowed[:, None], found.rank * allowed)
