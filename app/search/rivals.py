"""What else could explain a term: the best of every family, and whether the rows can tell."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.search.findings import Rival
from app.search.joint_fit import fit_terms, inverse, share_of
from app.search.names import STRONG, offset_of
from app.search.problem import Term
from app.search.refinement import refine
from app.search.selection import GRID_MARGIN, GRID_SHARE, Selector, best_entries

SAME_SIGNAL: Final = 0.95
"""Share of a signal above which a rival is tied up to twice STRONG."""

OF_A_FAMILY: Final = 3
"""Members of a family that are looked at closely."""


def find_rivals(selector: Selector, terms: Sequence[Term], number: int) -> list[tuple[Rival, Term]]:
    """Compare one term with the best of every family in its place.

    Returns
    -------
    list of (Rival, Term)
        The closest first; of the term's own family only members that are tied.
    """
    term, others = terms[number], [t for i, t in enumerate(terms) if i != number]
    score = _score(selector, term, others)
    base = selector.fit(others).log_likelihood
    term_evidence = selector.evidence(term, others, base)
    level = selector.fit([*others, term]).log_likelihood
    rivals = []
    for candidate in _candidates(selector, term, score, term_evidence):
        rival = selector.library.term(candidate)
        # Of an expected amplitude the scan says at most too much.
        hidden = GRID_MARGIN + (
            0.0 if rival.candidate.expected else GRID_SHARE * abs(term_evidence)
        )
        if score[candidate] > term_evidence - hidden:
            rival = selector.refined(rival, others)
        behind = term_evidence - selector.evidence(rival, others, base)
        share = alias_share(selector, term, rival, others)
        described = _rival(rival, behind, share)
        if not described.tied and share > SAME_SIGNAL and _may_both_be_zeros(term, rival):
            unlike = 2.0 * (level - selector.fit([*others, rival]).log_likelihood)
            described = replace(described, tied=unlike < STRONG)
        rivals.append((described, rival))
    rivals = _with_offset(selector, term, others, term_evidence, rivals) + _forms(
        selector, term, others
    )
    same = term.candidate.family
    of_other_families = [f for f in _best_of_families(rivals) if f[0].tied or f[0].family != same]
    return sorted(of_other_families, key=lambda f: f[0].behind)


def find_all_rivals(
    selector: Selector, terms: Sequence[Term]
) -> tuple[list[Term], list[list[tuple[Rival, Term]]]]:
    """Compare all terms with their rivals, and state the plainer one of two that grow or begin.

    Of what bends with temperature and what stays as it was seen, which fit alike, the latter claims
    no more than was seen: the other is its rival.

    Returns
    -------
    terms, rivals
        The terms that are stated, and each one's rivals; of known terms none.
    """
    terms_named, rivals = list(terms), []
    for i, term in enumerate(terms):
        pairs = [] if term.origin is not None else find_rivals(selector, terms_named, i)
        plainer = [
            t
            for rival, t in pairs
            if rival.tied and rival.alias_share > SAME_SIGNAL and claims_less(t, term)
        ]
        if plainer:
            others = terms_named[:i] + terms_named[i + 1 :]
            problem, states = selector.library.problem, selector.states
            terms_named[i] = refine(problem, states, plainer[0], others, errors=True)
            pairs = find_rivals(selector, terms_named, i)
        rivals.append(pairs)
    return terms_named, rivals


def claims_less(term: Term, other: Term) -> bool:
    """Whether a term stays as it was seen, where another that begins alike bends with temperature.

    Of two such in one channel.
    """
    bends = other.candidate.about is not None and term.candidate.about is None
    return bends and _may_both_be_zeros(term, other)


def _may_both_be_zeros(term: Term, rival: Term) -> bool:
    """Whether both grow or begin with time in one channel, where taking fewer numbers says nothing.

    A component that moved once, as its sensor's bias would move it, did so by chance or because
    what moved it expands: that it takes one number less is no evidence of the sensor.
    """
    return all(
        claim.candidate.trending and not claim.candidate.keeps_zero for claim in (term, rival)
    )


def better_forms(term: Term, rivals: Sequence[tuple[Rival, Term]]) -> tuple[str, ...]:
    """Say which forms of a term the values prefer to it as clearly as they tell any two apart."""
    words = {form.candidate.key: form.words for form in term.candidate.forms()}
    return tuple(
        words[rival.key]
        for rival, _ in rivals
        if rival.key in words and not _is_tied(-rival.behind, rival.alias_share)
    )


def _forms(selector: Selector, term: Term, others: Sequence[Term]) -> list[tuple[Rival, Term]]:
    """Hold a term's other forms beside it; they have as many parameters as the term itself."""
    pairs = []
    level = selector.fit([*others, term]).log_likelihood
    for form in term.candidate.forms():
        terms_of_form = [
            selector.library.problem.term(form.candidate, t) for t in form.candidate.thetas
        ]
        best = max(terms_of_form, key=lambda t: selector.fit([*others, t]).log_likelihood)
        rival = selector.refined(best, others)
        behind = 2.0 * (level - selector.fit([*others, rival]).log_likelihood)
        share = alias_share(selector, term, rival, others)
        pairs.append((_rival(rival, behind, share), rival))
    return pairs


def _with_offset(
    selector: Selector,
    term: Term,
    others: Sequence[Term],
    term_evidence: float,
    pairs: list[tuple[Rival, Term]],
) -> list[tuple[Rival, Term]]:
    """Try all rivals once more with a constant beside them, which has its own cost.

    A driver that counts from another zero than the maps' is a rival far behind without it.
    """
    offset = offset_of(selector, term)
    if offset is None or not offset.columns:
        return pairs
    beside = [*others, offset]
    level, base = (selector.fit(terms).log_likelihood for terms in (beside, others))
    count = sum(state.count for state in selector.states.values())
    gain = 2.0 * (level - base) - offset.size * float(np.log(count))
    score = _score(selector, term, beside)
    tied = {rival.key for rival, _ in pairs if rival.tied}
    closest: dict[str, tuple[Rival, Term]] = {}
    tried = Counter[str]()
    for entry in best_entries(score, selector.groups, term_evidence - gain - GRID_MARGIN):
        candidate = selector.library.candidates[selector.library.entries[entry].candidate]
        if candidate is term.candidate or candidate.key in tied or candidate.family in closest:
            continue
        tried[candidate.family] += 1
        if tried[candidate.family] > OF_A_FAMILY:
            continue
        rival = selector.refined(selector.library.term(entry), beside)
        evidence = selector.evidence(rival, beside, level)
        behind = term_evidence - gain - evidence
        # Where the constant alone does it, whatever is tried beside it is no rival.
        if behind < STRONG < evidence:
            share = alias_share(selector, term, rival, beside)
            described = Rival(
                candidate.key, candidate.family, rival.theta, behind, share, True, with_offset=True
            )
            closest[candidate.family] = (described, rival)
    keys = {rival.key for rival, _ in closest.values()}
    return [*closest.values(), *(pair for pair in pairs if pair[0].key not in keys)]


def alias_share(selector: Selector, term: Term, rival: Term, others: Sequence[Term]) -> float:
    """Give the share of a term's fitted signal that a rival reproduces.

    Returns
    -------
    float
        0: nothing; 1: the rows cannot tell them apart at all.
    """
    near = {c: s for c, s in selector.states.items() if c in term.columns or c in rival.columns}
    fit = fit_terms(near, [*others, term])
    first, k = sum(t.size for t in others), term.size
    size = first + k + rival.size
    information = np.zeros((size, size))
    for c, state in near.items():
        share = share_of(state, [*others, term, rival])
        at = np.ix_(share.index, share.index)
        information[at] += share.gram[fit.level[c]] / fit.scatter[c]
    # Schur's complement: what the rows say of term and rival once all other terms are fitted anew.
    crossed = information[:first, first:]
    conditional = (
        information[first:, first:] - crossed.T @ inverse(information[:first, :first]) @ crossed
    )
    a = fit.amplitudes[first:]
    signal = float(a @ conditional[:k, :k] @ a)
    reach = conditional[k:, :k] @ a
    reproduced = float(reach @ inverse(conditional[k:, k:]) @ reach)
    return float(np.clip(reproduced / signal, 0.0, 1.0)) if signal > 0 else 0.0


def _score(selector: Selector, term: Term, beside: Sequence[Term]) -> FloatArray:
    """Give the evidence of each entry beside other terms, shape (entries,).

    −∞ of what acts on other channels than the term: it explains none of the term's values, however
    good it is where it acts.
    """
    may_explain = selector.beside(beside) & selector.library.acts_on(term.channels)
    return np.where(may_explain, selector.scan(beside).ratio - selector.penalty, -np.inf)


def _candidates(
    selector: Selector, term: Term, score: FloatArray, term_evidence: float
) -> list[int]:
    """List the best members of each family, but for the term's own candidate."""
    library, taken = selector.library, dict[str, int]()
    chosen = []
    for entry in best_entries(score, selector.groups, -1e300):
        candidate = library.candidates[library.entries[entry].candidate]
        if candidate is term.candidate:
            continue
        count = taken.get(candidate.family, 0)
        close = score[entry] > term_evidence - 2 * STRONG - 0.2 * abs(term_evidence)
        if count == 0 or (count < OF_A_FAMILY and close):
            taken[candidate.family] = count + 1
            chosen.append(entry)
    return chosen


def _rival(rival: Term, behind: float, share: float) -> Rival:
    candidate, tied = rival.candidate, _is_tied(behind, share)
    return Rival(candidate.key, candidate.family, rival.theta, behind, share, tied)


def _is_tied(behind: float, share: float) -> bool:
    # Where the signals are almost one, 2 ln B rests on small differences between columns, which
    # a model that is a little wrong shifts as much: twice the evidence is asked for.
    return behind < STRONG or (behind < 2 * STRONG and share > SAME_SIGNAL)


def _best_of_families(pairs: list[tuple[Rival, Term]]) -> list[tuple[Rival, Term]]:
    """Keep each family's best, and everything that is tied."""
    best: dict[str, float] = {}
    for rival, _ in pairs:
        best[rival.family] = min(best.get(rival.family, np.inf), rival.behind)
    return [f for f in pairs if f[0].tied or f[0].behind <= best[f[0].family]]
