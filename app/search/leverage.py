"""On how few visits the evidence for a term stands."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from app.arrays import FloatArray
from app.search.foresight import Learned, learn
from app.search.model import Model
from app.search.problem import Term
from app.search.selection import Selector

STRONGEST = 2
"""So many visits are named."""


def leverage(
    selector: Selector, terms: Sequence[Term], number: int
) -> tuple[tuple[int, ...], float]:
    """Find the visits that carry most of the evidence for a term.

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
    by_visit: dict[int, float] = defaultdict(float)
    by_block: dict[int, float] = defaultdict(float)
    for channel in term.channels:
        before, after = (_by_block(m, full, channel) for m in (without, full))
        near_channel, use = near[channel].fixed.channel, near[channel].blocks
        numbers = zip(
            near_channel.blocks.setups[use].tolist(),
            near_channel.numbers[use].tolist(),
            strict=True,
        )
        for (visit, block), gain in zip(numbers, before - after, strict=True):
            by_visit[visit] += float(gain)
            by_block[block] += float(gain)
    strongest = sorted(by_visit, key=lambda v: (-by_visit[v], v))[:STRONGEST]
    # One or two long visits always carry everything: there, moments are what evidence stands on.
    gains = by_visit if len(by_visit) > STRONGEST else by_block
    largest = sorted((max(g, 0.0) for g in gains.values()), reverse=True)
    total = sum(largest)
    return tuple(strongest), sum(largest[:STRONGEST]) / total if total > 0 else 1.0


def _by_block(model: Learned, weights: Learned, channel: int) -> FloatArray:
    """Give each block's weighted squares left by a model, weights from the full one."""
    state = model.states[channel]
    fixed = state.fixed.channel
    residuals = fixed.values - model.prediction(channel)
    # Blocks that scatter together share their squares r'V⁻¹r: each has r_i'(V⁻¹r)_i of them.
    setups = Model(state, weights.fit.level[channel]).setups(residuals)
    taken = np.sum(fixed.reduce(residuals[:, None])[state.blocks, :, 0] * setups, axis=1)
    squares = np.add.reduceat(residuals**2, fixed.starts)[state.blocks] - taken
    return np.asarray(squares / weights.fit.scatter[channel])
