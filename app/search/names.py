"""Whether a found term's name is right, or only roughly so: a test of its flexible versions.

If the name is right, flexible versions of the term explain no more than noise does. They are few,
so that this test sees what the generic one, over all smooth shapes there are, cannot.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray
from app.search.alike import Alike, evidence_beside_alike, how_alike, set_ups_seen
from app.search.base_grams import BaseGrams
from app.search.candidate import OFFSET, Candidate, Part
from app.search.draws import Draws
from app.search.foresight import Learned, learn
from app.search.levels import NEGLIGIBLE
from app.search.library import read_library
from app.search.problem import Problem, Term, places
from app.search.rows import Datum
from app.search.scan import scan
from app.search.selection import Selector
from app.search.threshold import threshold
from app.search.walk import may_be_walk, walk_seen

STRONG: Final = 6.0
"""2 ln of a likelihood ratio, or of a Bayes factor, from which evidence is strong, and below which
two explanations are tied (Kass, Raftery, J. Am. Stat. Assoc. 90 (1995) 773)."""

WANDERS_ALONE: Final = "what it leaves wanders unlike the residuals of any other component"

WALKS: Final = "its set-ups look as if their zero shifted at random from one to the next"

ALIKE: Final = "its set-ups resemble each other, and what they have in common would look the same"


def name_doubts(selector: Selector, terms: Sequence[Term], draws: Draws) -> list[tuple[str, ...]]:
    """Say how the values depart from each term, beyond what noise would do.

    By chance, anything at all is said in one campaign of a hundred at the search's usual level.

    Returns
    -------
    list of tuple of str
        For each term the words of the flexible versions that the values prefer; empty: none.
    """
    candidates: list[Candidate] = []
    of_term: list[int] = []
    for number, term in enumerate(terms):
        if term.origin is not None or term.candidate.flexible is None:
            continue
        for version in term.candidate.flexible(term.theta):
            if version.words != OFFSET:
                parts = _unlike(selector.library.problem, term, version.parts)
                candidates.append(_candidate(f"{number}: {version.words}", parts))
                of_term.append(number)
    odd = _odd_wanderers(selector, terms)
    said: list[list[str]] = [
        [] if term.origin is not None or odd.isdisjoint(term.channels) else [WANDERS_ALONE]
        for term in terms
    ]
    beside = _Beside.of(selector, terms)
    for number in _walking(beside):
        said[number].append(WALKS)
    for number in _alike(selector, beside):
        said[number].append(ALIKE)
    if not candidates:
        return [tuple(words) for words in said]
    problem = selector.library.problem
    library = read_library(problem, candidates, draws)
    base = BaseGrams(library, selector.states)
    scanned = scan(library, selector.given(terms), base, draws, generic=True)
    entries = np.array([entry.candidate for entry in library.entries], dtype=np.intp)
    limit = threshold(
        scanned,
        entries,
        np.array(of_term, dtype=np.intp)[entries],
        selector.false_alarm,
        problem.has_expected_wander,
    )
    surprising = (limit.excess(scanned) >= 0) & (scanned.rank > 0)
    for i in np.flatnonzero(surprising).tolist():
        candidate = entries[i]
        said[of_term[candidate]].append(candidates[candidate].key.partition(": ")[2])
    return [tuple(dict.fromkeys(words)) for words in said]


def _odd_wanderers(selector: Selector, terms: Sequence[Term]) -> set[int]:
    """Name the channels whose residuals wander in a way that the others make improbable.

    A channel that wanders alone has a cause of its own. Within one record, held-out stretches would
    confirm a term that only imitates part of that wander.
    """
    odd = set()
    for c, state in selector.given(terms).items():
        expected = state.fixed.channel.expected
        if expected is None:
            continue
        believed = np.log(expected)
        wandering = state.null - believed
        ratio = 2.0 * float(wandering.max() - (state.null - believed.max()).max())
        if ratio > STRONG:
            odd.add(c)
    return odd


class _Beside(NamedTuple):
    """What is left beside terms: by channel, residuals, their set-ups, and what terms explain.

    `is_free` says for each row whether the zero of its set-up is not known.
    """

    terms: Sequence[Term]
    learned: Learned
    residuals: dict[int, FloatArray]
    visit: dict[int, IntArray]
    is_free: dict[int, BoolArray]

    @classmethod
    def of(cls, selector: Selector, terms: Sequence[Term]) -> _Beside:
        rows = selector.library.problem.rows
        learned = learn(selector.states, terms)
        channels = {c: state.fixed.channel for c, state in selector.states.items()}
        visit = {c: rows.visit[channel_.rows] for c, channel_ in channels.items()}
        free = {
            c: np.array(
                [rows.datum.get((v, c), Datum.ABSOLUTE) != Datum.ABSOLUTE for v in visits.tolist()]
            )
            for c, visits in visit.items()
        }
        residuals = {c: channel_.values - learned.effect(c) for c, channel_ in channels.items()}
        return cls(terms, learned, residuals, visit, free)

    @property
    def seen(self) -> dict[int, FloatArray]:
        """What set-ups show of the channels whose every zero is known."""
        return {
            c: set_ups_seen(self.residuals[c], self.visit[c])
            for c, free in self.is_free.items()
            if not free.any()
        }

    def explained(self, number: int) -> dict[int, FloatArray]:
        """Say what one of the terms explains of each channel that it acts on."""
        term = self.terms[number]
        amplitudes = self.learned.fit.amplitudes[places(self.terms)[number]]
        return {c: columns @ amplitudes for c, columns in term.columns.items()}


def _walking(beside: _Beside) -> list[int]:
    """Name the terms that grow or begin with time but may be zeros that walk at random.

    Zeros of different channels walk independently: one channel that rules it out is enough.
    """
    trending = [n for n, t in enumerate(beside.terms) if t.origin is None and t.candidate.trending]
    if not trending:
        return []
    seen = {c: walk_seen(residuals, beside.visit[c]) for c, residuals in beside.residuals.items()}
    walking = []
    for number in trending:
        judged = []
        for c, part in beside.explained(number).items():
            others = [w for other, w in seen.items() if other != c and w is not None]
            judged.append(may_be_walk(beside.residuals[c] + part, part, beside.visit[c], others))
        if True in judged and False not in judged:
            walking.append(number)
    return walking


def set_ups_alike(selector: Selector, terms: Sequence[Term]) -> Alike:
    """Say how much set-ups resemble each other beside terms."""
    return how_alike(list(_Beside.of(selector, terms).seen.values()))


def _alike(selector: Selector, beside: _Beside) -> list[int]:
    """Name the terms that stand still but may be mostly what set-ups have in common."""
    standing = [n for n, t in enumerate(beside.terms) if t.origin is None and t.candidate.standing]
    if not standing:
        return []
    tilt, seen = selector.library.problem.rows.tilt, beside.seen
    alike = []
    for number in standing:
        term = beside.terms[number]
        evidence = [
            evidence_beside_alike(
                beside.residuals[c],
                part,
                tilt[selector.states[c].fixed.channel.rows],
                beside.visit[c],
                beside.is_free[c],
                [likelihood for other, likelihood in seen.items() if other != c],
            )
            for c, part in beside.explained(number).items()
        ]
        certain = [value for value in evidence if value is not None]
        setups = max(np.unique(beside.visit[c]).size for c in term.columns)
        # What all set-ups have in common is one number, known by as many values as there are
        # set-ups.
        cost = selector.odds_of_family(term) + np.log(setups)
        if certain and sum(certain) < cost:
            alike.append(number)
    return alike


def offset_of(selector: Selector, term: Term) -> Term | None:
    """Make the constant beside a term; None where there is none to be made."""
    flexible = term.candidate.flexible
    if flexible is None:
        return None
    for version in flexible(term.theta):
        if version.words == OFFSET:
            return selector.library.problem.term(_candidate(OFFSET, version.parts), None)
    return None


def _unlike(problem: Problem, term: Term, parts: Sequence[Part]) -> Sequence[Part]:
    """Take from a flexible version its share of the term itself, where several channels share that.

    Shared amplitudes stand at their joint estimate while anything beside them is tested. A second
    time constant is nearly the first one again: it would show by moving that amplitude alone.
    """
    if len(term.columns) == 1:
        return parts
    parts_of_term = term.candidate.columns(term.theta)
    used = problem.place >= 0
    weights = np.zeros(len(problem.place))
    for c, fixed in problem.fixed.items():
        weights[used & (problem.rows.channel == c)] = 1.0 / fixed.channel.scale
    itself, version = (_over_all_rows(each, len(weights)) for each in (parts_of_term, parts))
    weighted = weights[:, None] * itself
    shares = np.linalg.lstsq(weighted, weights[:, None] * version, rcond=None)[0]
    residual = version - itself @ shares
    size, before = (np.linalg.norm(weights[:, None] * each, axis=0) for each in (residual, version))
    residual = residual[:, size > NEGLIGIBLE * before]
    rows = {c: np.flatnonzero(problem.rows.channel == c) for c in term.columns}
    return [Part(c, here, residual[here]) for c, here in rows.items() if residual.shape[1]]


def _over_all_rows(parts: Sequence[Part], count: int) -> FloatArray:
    """Lay parts out over all rows, shape (n, k)."""
    matrix: FloatArray = np.zeros((count, parts[0].columns.shape[1] if parts else 0))
    for part in parts:
        matrix[part.rows] += part.columns
    return matrix


def _candidate(key: str, parts: Sequence[Part]) -> Candidate:
    return Candidate.of_parts(key, "flexible", parts, generic=True, within_visit=True)
