"""What cannot be a measurement of this machine: rows and visits far from all others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.linalg import solve_triangular

from app.arrays import BoolArray, FloatArray, IntArray
from app.search.channel import Channel
from app.search.findings import Excluded
from app.search.moments import fixed_of
from app.search.noise import NORMAL
from app.search.problem import make_problem
from app.search.rows import Nuisance, Rows
from app.search.scatter import FEWEST_BLOCKS, Scatter
from app.search.state import State

OUTLIER: Final = 5.0
"""Robust standard deviations from which a row or a visit is an outlier."""

MOST_OUTLIERS: Final = 0.05
"""If more than this share is far, it is structure, not outliers."""

SLIP_RATIO: Final = 3.0
"""A visit must be so many times further away than the next one to be a slip: effects last longer.

The last visit is none: what has just changed looks the same.
"""

LOOSE: Final = Scatter(80.0, 80.0)
"""What rows share where they are judged within their visit: a loose set-up, and in a long one"""

LOOSE_IN_TIME: Final = Scatter(80.0, 80.0, 40.0, 30.0)
"""a loose wander too: what changes within half an hour makes no outliers."""

ROUNDS: Final = 3


def screen(rows: Rows, nuisance: Sequence[Nuisance]) -> tuple[BoolArray, list[Excluded]]:
    """Find outliers among rows and among visits, held-out ones alike.

    Rows are judged within their visit, beside freely shifting and tilting visits, so that
    an effect that changes from visit to visit makes no outliers.

    Returns
    -------
    use : ndarray, shape (n,)
        Rows that take part.
    excluded : list of Excluded
        The others, with the reason.
    """
    use = np.ones(len(rows.values), dtype=bool)
    for _ in range(ROUNDS):
        far = _outlying_rows(rows, nuisance, use)
        use[far] = False
        if not len(far):
            break
    often = _too_many(rows, use)
    use |= np.isin(rows.channel, often)
    excluded = [
        Excluded(tuple(np.flatnonzero(~use & (rows.channel == c)).tolist()), "outlier", int(c))
        for c in np.unique(rows.channel[~use])
    ]
    apart = _visits_apart(rows, nuisance, use)
    for one in apart:
        use[list(one.rows)] = False
    return use, excluded + apart


def _channels(rows: Rows, nuisance: Sequence[Nuisance], use: BoolArray) -> list[Channel]:
    cell_of = {int(b): 0 for b in np.unique(rows.block)}
    problem = make_problem(rows, nuisance, use, cell_of, 1)
    return [f.channel for f in problem.fixed.values()]


def _outlying_rows(rows: Rows, nuisance: Sequence[Nuisance], use: BoolArray) -> IntArray:
    found = [np.zeros(0, dtype=np.intp)]
    for channel in _channels(rows, nuisance, use):
        left, _ = _left(channel)
        size = NORMAL * float(np.median(np.abs(left - np.median(left))))
        if size > 0:
            # Not below half the repeatability, which a few equal readings would undercut.
            found.append(channel.rows[np.abs(left - np.median(left)) > OUTLIER * max(size, 0.5)])
    return np.concatenate(found)


def _left(channel: Channel) -> tuple[FloatArray, FloatArray]:
    """Give what is left within visits, and each visit's shift."""
    scatter = LOOSE_IN_TIME if channel.blocks.are_records else LOOSE
    loose = replace(channel, tried=(scatter,), prior=np.zeros(1))
    state = State(fixed_of(loose, 1), np.ones(1, dtype=bool))
    level = state.levels[0]
    lower = state.shadows[0][0, level.turned.shape[1] :]
    maps = solve_triangular(level.root[0], lower, lower=True, trans=1) if len(lower) else lower
    values = channel.values - (channel.nuisance @ maps)[:, 0]
    turned = level.whitening.turn(channel.reduce(values[:, None]))
    shared = level.whitening.turn_back(turned, level.shapes)[0].reshape(-1, level.shapes)
    return values - np.sum(channel.shapes * shared[channel.block], axis=1), shared[:, 0]


def _too_many(rows: Rows, use: BoolArray) -> list[int]:
    return [
        int(c) for c in np.unique(rows.channel) if np.mean(~use[rows.channel == c]) > MOST_OUTLIERS
    ]


def _visits_apart(rows: Rows, nuisance: Sequence[Nuisance], use: BoolArray) -> list[Excluded]:
    """A slip of one visit stands alone: far from the rest and from the next furthest."""
    found = []
    for channel in _channels(rows, nuisance, use):
        if channel.blocks.are_records:  # what lies apart in time may be what moved
            continue
        _, shift = _left(channel)
        known = np.flatnonzero(~channel.blocks.free)
        if len(known) < FEWEST_BLOCKS:
            continue
        away = np.abs(shift[known] - np.median(shift[known]))
        size = NORMAL * float(np.median(away))
        order = np.argsort(away)
        first, second = away[order[-1]], away[order[-2]]
        if first > OUTLIER * max(size, 0.3) and first > SLIP_RATIO * second:
            visit = int(channel.blocks.setups[known[order[-1]]])
            if visit == channel.blocks.setups.max():
                continue
            gone = channel.rows[(channel.blocks.setups == visit)[channel.block]]
            found.append(
                Excluded(tuple(sorted(gone.tolist())), "visit-apart", channel.number, visit)
            )
    return found
