"""On how few visits the evidence for a term stands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.arrays import FloatArray
from app.search.foresight import Learned, learn
from app.search.problem import Term
from app.search.selection import Selector
from app.search.visit_scatter import factors

STRONGEST = 2
"""So many visits are named."""


def leverage(
    selector: Selector, terms: Sequence[Term], number: int
) -> tuple[tuple[int, ...], float]:
    """Find the visits that carry most of the evidence for a term.

    Parameters
    ----------
    selector
        Holds the rows that take part.
    terms
        All terms.
    number
        Which of them.

    Returns
    -------
    visits : tuple of int
        The strongest two.
    share : float
        Their share of all visits' gains, 0 to 1.
    """
    term = terms[number]
    near = {c: s for c, s in selector.states.items() if c in term.columns}
    others = [t for i, t in enumerate(terms) if i != number]
    full, without = learn(near, terms), learn(near, others)
    gains: dict[int, float] = {}
    for channel in term.channels:
        before, after = (_by_visit(m, full, channel) for m in (without, full))
        visits = near[channel].fixed.channel.visits[near[channel].blocks]
        for visit, gain in zip(visits.tolist(), before - after, strict=True):
            gains[visit] = gains.get(visit, 0.0) + float(gain)
    total = sum(max(g, 0.0) for g in gains.values())
    strongest = sorted(gains, key=lambda v: (-gains[v], v))[:STRONGEST]
    held = sum(max(gains[v], 0.0) for v in strongest)
    return tuple(strongest), held / total if total > 0 else 1.0


def _by_visit(model: Learned, weights: Learned, channel: int) -> FloatArray:
    """Give each visit's weighted squares left by a model, weights from the full one."""
    state = model.states[channel]
    fixed, level = state.fixed.channel, weights.fit.level[channel]
    left = fixed.values - model.prediction(channel)
    factor, _ = factors(fixed.gram, fixed.variances[level])
    turned = (factor @ fixed.reduce(left[:, None]))[..., 0]
    squares = np.add.reduceat(left**2, fixed.starts) - np.sum(turned**2, axis=1)
    return np.asarray(squares[state.blocks] / weights.fit.scatter[channel])
