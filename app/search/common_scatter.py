"""Whether a stated repeatability is contradicted by what all channels show alike.

Where no place was repeated, no single channel tells its noise from a cause that nobody knows. But
one instrument measured them all, and one number was stated for all of them: if what is left within
visits is as much too large, or too small, in nearly every channel and visit, and is white, then it
is the number that is wrong. What only some channels show stays what it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray
from app.search.channel import prepare
from app.search.moments import fixed_of
from app.search.noise import (
    COMMON,
    DENIED,
    ENOUGH_REPLICATES,
    pure_error,
    repeatability,
    shows_scatter,
)
from app.search.rows import Nuisance, Rows
from app.search.screening import Screened, Within, screen
from app.search.state import State

FEWEST_CHANNELS: Final = 5
"""Fewer may all be moved by one unknown cause, as points are."""

FEWEST_LEFT: Final = 4.0
"""Degrees of freedom below which a channel, or a visit, says nothing of its scatter."""

NEARLY_ALL: Final = 0.25
"""At most such a share of the channels, and of the visits, may show no contradiction."""

LEANING: Final = 1.25
"""Times what is stated from which it is looked at more closely: at a wrong scale the maps' own
uncertainty hides a part of the difference."""

SETTLED: Final = 0.03
"""Change below which a channel's scatter no longer changes."""

ROUNDS: Final = 8

WITHIN: Final = 2.0
"""Standard errors within which channels agree."""

MEDIAN: Final = 1.25
"""Standard error of a median over that of a mean."""

WHITE: Final = 3.0
"""Standard deviations by which neighbours may resemble each other by chance."""

SHUFFLES: Final = 200
"""Orders at random that say how much they do."""


class _Own(NamedTuple):
    """A channel's own scatter, over what is stated.

    Parameters
    ----------
    left : ndarray, shape (n,)
        What is left within visits, in its own scatter, freed of what visits have taken up.
    freedom : ndarray, shape (n,)
        Share of each row that they have not.
    """

    number: int
    ratio: float
    rows: IntArray
    left: FloatArray
    freedom: FloatArray


def screen_at_common_scatter(rows: Rows, nuisance: Sequence[Nuisance]) -> tuple[Rows, Screened]:
    """Screen rows, and screen them anew where they contradict the repeatability stated."""
    screened = screen(rows, nuisance)
    common = with_common_scatter(rows, nuisance, screened.use)
    return (rows, screened) if common is rows else (common, screen(common, nuisance))


def with_common_scatter(rows: Rows, nuisance: Sequence[Nuisance], use: BoolArray) -> Rows:
    """Replace a repeatability that nearly all channels and visits contradict by what they show.

    Parameters
    ----------
    use : ndarray, shape (n,)
        Which rows take part.

    Returns
    -------
    Rows
        The same ones where nothing is contradicted.
    """
    stated = [c for c in rows.noise if repeatability(rows, c, use).origin == "declared"]
    stated = [c for c in stated if shows_scatter(rows, c, use)]
    if len(stated) < FEWEST_CHANNELS:
        return rows
    first = [_own(rows, nuisance, c, use, rounds=1) for c in stated]
    side = _side(first, LEANING)
    if side == 0 or _repeats_agree(rows, stated, use, side):
        return rows
    own = [_own(rows, nuisance, c, use, rounds=ROUNDS) for c in stated]
    if _side(own, DENIED) != side:
        return rows
    factor, alike = _common(own)
    is_denied = factor**side >= DENIED
    if not (is_denied and _is_in_all_visits(rows, alike, side) and _is_white(rows, alike)):
        return rows
    noise = dict(rows.noise)
    for c in stated:
        value = factor * (noise[c].repeatability or 0.0)
        noise[c] = replace(noise[c], repeatability=value, origin=COMMON)
    return replace(rows, noise=noise)


def _own(
    rows: Rows, nuisance: Sequence[Nuisance], number: int, use: BoolArray, rounds: int
) -> _Own:
    """Estimate one channel's scatter by itself, whatever is stated."""
    cell_of = {int(b): 0 for b in np.unique(rows.block)}
    stated = repeatability(rows, number, use).value
    scale, ratio = stated, 1.0
    for _ in range(rounds):
        channel = prepare(rows, nuisance, number, scale, 0.0, use, cell_of)
        state = State(fixed_of(channel, 1), np.ones(1, dtype=bool))
        best = int(np.argmax(state.null))
        blocks = channel.blocks
        unknown = len(np.unique(blocks.setups[blocks.free]))  # zeros
        ratio = float(np.sqrt(state.rss[best] / max(state.count - unknown, 1)))
        scale *= ratio
        if abs(ratio - 1.0) < SETTLED:
            break
    within = Within(channel, channel.tried[best], np.ones(len(channel.rows)))
    left = within.off * within.alone / ratio
    return _Own(number, scale / stated, channel.rows, left, within.alone)


def side_of(ratios: FloatArray, freedom: FloatArray, margin: float = DENIED) -> int:
    """Say whether nearly all channels scatter by more (1) or less (−1) than is stated; else 0.

    Parameters
    ----------
    ratios : ndarray, shape (channels,)
        What each shows by itself, over what is stated.
    freedom : ndarray, shape (channels,)
        Its degrees of freedom.
    margin
        Times what is stated from which it is contradicted.
    """
    known = freedom >= FEWEST_LEFT
    if known.sum() < FEWEST_CHANNELS:
        return 0
    return _side_of(ratios[known], freedom[known], margin)


def _side(own: Sequence[_Own], margin: float) -> int:
    ratios, freedom = (
        np.array(of_each)
        for of_each in ([one.ratio for one in own], [one.freedom.sum() for one in own])
    )
    return side_of(ratios, freedom, margin)


def _side_of(ratios: FloatArray, freedom: FloatArray, margin: float) -> int:
    """Say so of some ratios, each no surer than its degrees of freedom make it."""
    away = np.log(ratios)
    limit = np.log(margin) - 1.0 / np.sqrt(2.0 * freedom)
    if np.mean(away < limit) <= NEARLY_ALL:
        return 1
    return -1 if np.mean(-away < limit) <= NEARLY_ALL else 0


def _repeats_agree(rows: Rows, stated: Sequence[int], use: BoolArray, side: int) -> bool:
    """Whether places that were repeated speak for what is stated: they have priority."""
    squares, freedom = 0.0, 0
    for c in stated:
        variance, own = pure_error(rows, c, use)
        squares += variance * own / repeatability(rows, c, use).value ** 2
        freedom += own
    if freedom < ENOUGH_REPLICATES:
        return False
    ratio = float(np.sqrt(squares / freedom))
    return ratio < DENIED if side > 0 else ratio > 1.0 / DENIED


def _common(own: Sequence[_Own]) -> tuple[float, list[_Own]]:
    """Pool the scatter of the channels that agree; what moves others makes theirs larger."""
    known = [one for one in own if one.freedom.sum() >= FEWEST_LEFT]
    away = np.log([one.ratio for one in known])
    freedom = np.array([one.freedom.sum() for one in known])
    off = away - np.median(away)
    # That the median of some channels is off by itself too.
    of_median = MEDIAN * np.std(away) / np.sqrt(len(away))
    agrees = np.abs(off) <= WITHIN * np.sqrt(1.0 / (2.0 * freedom) + of_median**2)
    alike = [one for one, it in zip(known, agrees.tolist(), strict=True) if it]
    squares = np.array([one.ratio**2 for one in alike])
    return float(np.sqrt(np.average(squares, weights=freedom[agrees]))), alike


def _is_in_all_visits(rows: Rows, alike: Sequence[_Own], side: int) -> bool:
    """Whether nearly every visit shows it: what comes and goes is no repeatability."""
    block = np.concatenate([rows.block[one.rows] for one in alike])
    squares = np.concatenate([(one.ratio * one.left) ** 2 for one in alike])
    of_rows = np.concatenate([one.freedom for one in alike])
    freedom = np.asarray(np.bincount(block, weights=of_rows), dtype=np.float64)
    known = freedom >= FEWEST_LEFT
    if not known.any():
        return False
    ratios = np.sqrt(np.bincount(block, weights=squares)[known] / freedom[known])
    return _side_of(ratios, freedom[known], DENIED) == side


def _is_white(rows: Rows, alike: Sequence[_Own]) -> bool:
    """Whether what is left beside each other in time or place resembles no more than by chance."""
    index = np.concatenate([one.rows for one in alike])
    left = np.concatenate([one.left for one in alike])
    group = rows.channel[index] * (1 + int(rows.block.max())) + rows.block[index]
    orders = [rows.minutes, *rows.tilt.T]
    random = np.random.default_rng(0)
    mixed = [_resemblance(left, group, random.random(len(left))) for _ in range(SHUFFLES)]
    limit = float(np.mean(mixed) + WHITE * np.std(mixed))
    return all(_resemblance(left, group, order[index]) <= limit for order in orders)


def _resemblance(left: FloatArray, group: IntArray, order: FloatArray) -> float:
    """Sum the products of neighbours in an order, within each group."""
    sequence = np.lexsort((order, group))
    values, of = left[sequence], group[sequence]
    return float(np.sum((values[1:] * values[:-1])[of[1:] == of[:-1]]))
