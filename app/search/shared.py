"""Whether a term's one size holds at all its places: a test against a size for each place.

A fingerprint with one parameter is cheap. Several causes that are nearly alike could pass for it,
with another term to explain how they differ.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.search.problem import Term
from app.search.selection import Selector


def not_shared(selector: Selector, terms: Sequence[Term]) -> set[str]:
    """Name the families of terms that have no common size: a size for each place explains more.

    Sizes of their own must pay for their extra parameters. What was chosen beside such a term may
    only explain how its places differ, so whatever no longer pays beside separate sizes goes.

    Parameters
    ----------
    terms
        As chosen, those that the model has already included.

    Returns
    -------
    set of str
        Families.
    """
    families = set()
    for i, term in enumerate(terms):
        if term.origin is not None or term.candidate.apart is None:
            continue
        apart = selector.library.problem.term(term.candidate.apart, term.theta)
        others = [*terms[:i], *terms[i + 1 :]]
        if _worth_apart(selector, term, apart, others) > _worth(selector, [*others, term]):
            families.add(term.candidate.family)
    return families


def _worth_apart(selector: Selector, term: Term, apart: Term, others: Sequence[Term]) -> float:
    """Give the evidence of a term's sizes apart, with those of the others that pay beside them."""
    count = sum(state.count for state in selector.states.values())
    price = (apart.size - term.size) * float(np.log(count)) + selector.price(term)
    remaining, best = list(others), _worth(selector, others, apart)
    while True:
        near = [t for t in remaining if t.origin is None and set(t.columns) & set(apart.columns)]
        fewer = [[t for t in remaining if t is not neighbour] for neighbour in near]
        worths = [_worth(selector, rest, apart) for rest in fewer]
        if max(worths, default=-np.inf) <= best:
            return best - price
        best = max(worths)
        remaining = fewer[worths.index(best)]


def _worth(selector: Selector, terms: Sequence[Term], beside: Term | None = None) -> float:
    """Give twice the log likelihood less what terms cost, but for the one that is beside them."""
    every = [*terms, *([] if beside is None else [beside])]
    fit = selector.fit(every)
    starts = np.cumsum([0, *(term.size for term in terms)])
    costs = [selector.cost(t, fit, int(at)) for t, at in zip(terms, starts, strict=False)]
    return 2.0 * float(fit.log_likelihood) - sum(costs)
