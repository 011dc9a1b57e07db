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
    is_denied,
    pure_error,
    repeatability,
    shows_scatter,
)
from app.search.rows import Nuisance, Rows
from app.search.screening import Screened, Within, screen
from app.search.state import State

FEWEST_CHANNELS: Final = 5
"""Fewer may all be moved by one unknown cause, as points are; none makes them scatter less."""

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


class _ChannelScatter(NamedTuple):
    """A channel's own scatter, over what is stated.

    Parameters
    ----------
    residuals : ndarray, shape (n,)
        What is left within visits, in its own scatter, freed of what visits have taken up.
    freedom : ndarray, shape (n,)
        Share of each row that they have not.
    """

    number: int
    ratio: float
    rows: IntArray
    residuals: FloatArray
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
    declared = [c for c in rows.noise if repeatability(rows, c, use).origin == "declared"]
    declared = [c for c in declared if shows_scatter(rows, c, use)]
    first = [_channel_scatter(rows, nuisance, c, use, rounds=1) for c in declared]
    side = _side(first, LEANING)
    if side == 0 or _repeats_agree(rows, declared, use, side):
        return rows
    scatters = [_channel_scatter(rows, nuisance, c, use, rounds=ROUNDS) for c in declared]
    if _side(scatters, DENIED) != side:
        return rows
    factor, alike = _common(scatters)
    freedom = int(sum(channel.freedom.sum() for channel in alike))
    if not (
        is_denied(1.0, factor**2, freedom, side)
        and _is_in_all_visits(rows, alike, side)
        and _is_white(rows, alike)
    ):
        return rows
    noise = dict(rows.noise)
    for c in declared:
        value = max(factor * (noise[c].repeatability or 0.0), noise[c].rounding)
        noise[c] = replace(noise[c], repeatability=value, origin=COMMON)
    return replace(rows, noise=noise)


def _channel_scatter(
    rows: Rows, nuisance: Sequence[Nuisance], number: int, use: BoolArray, rounds: int
) -> _ChannelScatter:
    """Estimate one channel's scatter by itself, whatever is stated."""
    cell_of = {int(b): 0 for b in np.unique(rows.block)}
    declared = repeatability(rows, number, use).value
    scale, ratio = declared, 1.0
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
    residuals = within.off * within.alone / ratio
    return _ChannelScatter(number, scale / declared, channel.rows, residuals, within.alone)


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
    enough = freedom >= FEWEST_LEFT
    if enough.sum() < FEWEST_CHANNELS:
        return 0
    return _side_of(ratios[enough], freedom[enough], margin)


def _side(scatters: Sequence[_ChannelScatter], margin: float) -> int:
    """Say so of channels; that they scatter by less, of few too."""
    freedom = np.array([channel.freedom.sum() for channel in scatters])
    ratios = np.array([channel.ratio for channel in scatters])
    enough = freedom >= FEWEST_LEFT
    side = _side_of(ratios[enough], freedom[enough], margin) if enough.any() else 0
    return side if side < 0 else side_of(ratios, freedom, margin)


def _side_of(ratios: FloatArray, freedom: FloatArray, margin: float) -> int:
    """Say so of some ratios, each no surer than its degrees of freedom make it."""
    away = np.log(ratios)
    # Of f degrees of freedom a standard deviation's logarithm has the standard error 1/√(2 f).
    limit = np.log(margin) - 1.0 / np.sqrt(2.0 * freedom)
    if np.mean(away < limit) <= NEARLY_ALL:
        return 1
    return -1 if np.mean(-away < limit) <= NEARLY_ALL else 0


def _repeats_agree(rows: Rows, declared: Sequence[int], use: BoolArray, side: int) -> bool:
    """Whether places that were repeated speak for what is stated: they have priority."""
    squares, freedom = 0.0, 0
    for c in declared:
        variance, channel_freedom = pure_error(rows, c, use)
        squares += variance * channel_freedom / repeatability(rows, c, use).value ** 2
        freedom += channel_freedom
    if freedom < ENOUGH_REPLICATES:
        return False
    ratio = float(np.sqrt(squares / freedom))
    return ratio < DENIED if side > 0 else ratio > 1.0 / DENIED


def _common(scatters: Sequence[_ChannelScatter]) -> tuple[float, list[_ChannelScatter]]:
    """Pool the scatter of the channels that agree; what moves others makes theirs larger."""
    determined = [channel for channel in scatters if channel.freedom.sum() >= FEWEST_LEFT]
    away = np.log([channel.ratio for channel in determined])
    freedom = np.array([channel.freedom.sum() for channel in determined])
    off = away - np.median(away)
    # That the median of some channels is off by itself too.
    of_median = MEDIAN * np.std(away) / np.sqrt(len(away))
    agrees = np.abs(off) <= WITHIN * np.sqrt(1.0 / (2.0 * freedom) + of_median**2)
    alike = [channel for channel, it in zip(determined, agrees.tolist(), strict=True) if it]
    squares = np.array([channel.ratio**2 for channel in alike])
    return float(np.sqrt(np.average(squares, weights=freedom[agrees]))), alike


def _is_in_all_visits(rows: Rows, alike: Sequence[_ChannelScatter], side: int) -> bool:
    """Whether nearly every visit shows it: what comes and goes is no repeatability."""
    block = np.concatenate([rows.block[channel.rows] for channel in alike])
    squares = np.concatenate([(channel.ratio * channel.residuals) ** 2 for channel in alike])
    of_rows = np.concatenate([channel.freedom for channel in alike])
    freedom = np.asarray(np.bincount(block, weights=of_rows), dtype=np.float64)
    enough = freedom >= FEWEST_LEFT
    if not enough.any():
        return False
    ratios = np.sqrt(np.bincount(block, weights=squares)[enough] / freedom[enough])
    return _side_of(ratios, freedom[enough], DENIED) == side


def _is_white(rows: Rows, alike: Sequence[_ChannelScatter]) -> bool:
    """Whether what is left beside each other in time or place resembles no more than by chance."""
    index = np.concatenate([channel.rows for channel in alike])
    residuals = np.concatenate([channel.residuals for channel in alike])
    group = rows.channel[index] * (1 + int(rows.block.max())) + rows.block[index]
    orders = [rows.minutes, *rows.tilt.T]
    # Always the same orders: the same values have to get the same answer.
    random = np.random.default_rng(0)
    mixed = [_resemblance(residuals, group, random.random(len(residuals))) for _ in range(SHUFFLES)]
    limit = float(np.mean(mixed) + WHITE * np.std(mixed))
    return all(_resemblance(residuals, group, order[index]) <= limit for order in orders)


def _resemblance(residuals: FloatArray, group: IntArray, order: FloatArray) -> float:
    """Sum the products of neighbours in an order, within each group."""
    sequence = np.lexsort((order, group))
    values, of = residuals[sequence], group[sequence]
    return float(np.sum((values[1:] * values[:-1])[of[1:] == of[:-1]]))
