"""Terms that follow the same course in time, at least one of them late: which may be combined.

Low-passes of one course with neighbouring time constants are nearly equal. Two of them, with
amplitudes that nearly cancel, imitate whatever is left, at any size. The response of a place to one
course is therefore described by one late term at most; beside it a part may follow at once, with
the same sign, as when one source warms two bodies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from app.arrays import BoolArray
from app.search.candidate import Candidate
from app.search.joint_fit import fit_terms
from app.search.library import Library
from app.search.problem import Term
from app.search.state import State


def is_late(candidate: Candidate) -> bool:
    """Whether a candidate follows a course late: it has a time constant."""
    return bool(candidate.follows) and candidate.nonlinear > 0


def second_late(library: Library, others: Sequence[Term]) -> BoolArray:
    """Say which entries follow late what one of the others follows late already.

    Returns
    -------
    ndarray, shape (entries,)
    """
    taken = {name for term in others if is_late(term.candidate) for name in term.candidate.follows}
    if not taken:
        return np.zeros(len(library.entries), dtype=np.bool_)
    is_second = [is_late(c) and not taken.isdisjoint(c.follows) for c in library.candidates]
    return np.array([is_second[entry.candidate] for entry in library.entries], dtype=np.bool_)


def taken_back(states: Mapping[int, State], terms: Sequence[Term]) -> list[int]:
    """List the late terms that take an amplitude of what comes at once back, or have theirs taken.

    Parameters
    ----------
    states
        Channel to its state, without given terms.
    terms
        Terms that stand beside each other.

    Returns
    -------
    list of int
        Places of late terms, in their order.
    """
    pairs = [
        (i, j, late.candidate.follows[name] * sign)
        for i, late in enumerate(terms)
        if is_late(late.candidate)
        for j, other in enumerate(terms)
        if not is_late(other.candidate)
        for name, sign in other.candidate.follows.items()
        if name in late.candidate.follows
    ]
    if not pairs:
        return []
    fit, starts = fit_terms(states, terms), np.cumsum([0, *(term.size for term in terms)])
    sizes = [
        fit.amplitudes[start : start + term.size] / np.where(term.norms > 0, term.norms, np.inf)
        for start, term in zip(starts, terms, strict=False)
    ]
    return sorted({i for i, j, sign in pairs if sign * float(sizes[i] @ sizes[j]) < 0.0})
