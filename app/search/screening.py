"""What cannot be a measurement of this machine: rows and visits far from all others.

Rows are judged beside freely shifting and tilting visits, so that an effect that changes from
visit to visit makes no outliers: each by what the other rows foretell of it.

D. Cook, S. Weisberg, Residuals and Influence in Regression (1982): residuals of deleted rows.
P. Holland, R. Welsch, Commun. Stat. A 6 (1977) 813: reweighted least squares, Cauchy's weights.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from scipy.special import bdtrc

from app.arrays import BoolArray, FloatArray, IntArray, robust_sd
from app.search.channel import Channel
from app.search.findings import Excluded
from app.search.model import Model
from app.search.moments import fixed_of
from app.search.priors import DECLARED_WEIGHT, SLIPS
from app.search.problem import prepared
from app.search.rows import Nuisance, Rows
from app.search.scatter import FEWEST_BLOCKS, Scatter
from app.search.state import State

OUTLIER: Final = 5.0
"""Robust standard deviations from which a row or a visit is an outlier."""

FEW: Final = 12.0
"""A scale of n rows is taken for larger by so many nth: few that happen to be equal make no others
far."""

TOO_MANY: Final = 0.01
"""Probability of as many slips in a channel, from which what is far is structure instead."""

ALIKE: Final = 3.0
"""Robust standard deviations within which two that are far are off by the same."""

ALL_ALIKE: Final = 0.03
"""Probability of as many slips that are off by the same, from which they are something else."""

FEWEST: Final = 3
"""Fewer that are far say nothing of what moved them."""

SLIP_RATIO: Final = 3.0
"""A visit must be so many times further away than the next one to be a slip: effects last longer.

The last visit is none: what has just changed looks the same.
"""

LOOSE: Final = Scatter(80.0, 80.0)
"""What rows share where they are judged within their visit: a loose set-up, and in a long one"""

LOOSE_IN_TIME: Final = Scatter(80.0, 80.0, 40.0, 30.0)
"""a loose wander too: what changes within half an hour makes no outliers."""

FREE: Final = Scatter(1e5, 1e5)
"""And what rows of a visit share that has moved as no other has; in a long one"""

FREE_IN_TIME: Final = Scatter(1e5, 1e5, 40.0, 30.0)
"""beside the loose wander."""

SOFT: Final = 2.0
"""Robust standard deviations from which a row that is further than that counts for less than a
fifth (Cauchy's weights)."""

SETTLED: Final = 0.02
"""Change of all weights below which they no longer change anything."""

ROUNDS: Final = 20


@dataclass(frozen=True, eq=False)
class Screened:
    """Which rows take part, and why the others do not.

    Parameters
    ----------
    use : ndarray, shape (n,)
        Rows that take part.
    far : ndarray, shape (n,)
        Rows that are far from the others of their visit, those that take part all the same
        because they are too many included.
    values : ndarray, shape (n,)
    by_channel
        Each channel's rows that are far, and by how much.
    """

    use: BoolArray
    excluded: tuple[Excluded, ...]
    far: BoolArray
    values: FloatArray
    by_channel: Mapping[int, _Far]

    def doubtful(self, rows: Rows) -> BoolArray:
        """Find what an effect may have moved: several rows of a channel, in several visits."""
        doubtful = np.zeros(len(self.use), dtype=bool)
        for exclusion in self.excluded:
            excluded_rows = list(exclusion.rows)
            if exclusion.visit is None and len(np.unique(rows.visit[excluded_rows])) > 1:
                doubtful[excluded_rows] = True
        return doubtful

    def is_explained_by(self, beside: Screened, rows: Rows) -> bool:
        """Whether most of a channel's doubtful rows are no longer far, and no others are instead.

        Parameters
        ----------
        beside
            The same rows, screened beside effects.
        """
        doubtful = self.doubtful(rows)
        for number in np.unique(rows.channel[doubtful]):
            of_channel = rows.channel == number
            back = of_channel & doubtful & ~beside.far
            fewer = (self.far & of_channel).sum() - (beside.far & of_channel).sum()
            if len(np.unique(rows.visit[back])) > 1 and 2 * fewer > (doubtful & of_channel).sum():
                return True
        return False


def screen(rows: Rows, nuisance: Sequence[Nuisance], before: Screened | None = None) -> Screened:
    """Find outliers among rows and among visits, held-out ones alike.

    Parameters
    ----------
    before
        The same rows, screened with other values: channels whose values are still the same keep
        what is far of them.
    """
    use = np.ones(len(rows.values), dtype=bool)
    is_far = np.zeros(len(rows.values), dtype=bool)
    excluded, by_channel = [], {}
    for number in np.unique(rows.channel).tolist():
        of_channel = rows.channel == number
        if before is not None and np.array_equal(
            rows.values[of_channel], before.values[of_channel]
        ):
            far = before.by_channel[number]
        else:
            far = _far(rows, nuisance, number)
        by_channel[number] = far
        is_far[far.rows] = True
        if len(far.rows) and not _too_many(len(far.rows), int(of_channel.sum())):
            excluded.append(
                Excluded(
                    tuple(far.rows.tolist()),
                    "outlier",
                    number,
                    off=tuple(far.off.tolist()),
                    alike=tuple(_alike(rows, far).tolist()),
                )
            )
            use[far.rows] = False
    apart = _visits_apart(rows, nuisance, use)
    for exclusion in apart:
        use[list(exclusion.rows)] = False
    return Screened(use, (*excluded, *apart), is_far, rows.values, by_channel)


class _Far(NamedTuple):
    """A channel's rows that are far from what the others foretell, by how much, and how surely.

    Offsets and their standard deviations are in the channel's unit.
    """

    rows: IntArray
    off: FloatArray
    scatter: FloatArray


def _channel(rows: Rows, nuisance: Sequence[Nuisance], number: int, use: BoolArray) -> Channel:
    return prepared(rows, nuisance, number, use, {int(b): 0 for b in np.unique(rows.block)})


def _far(rows: Rows, nuisance: Sequence[Nuisance], number: int) -> _Far:
    """Find the rows of a channel that are far from what the others foretell."""
    channel = _channel(rows, nuisance, number, rows.channel == number)
    in_time = channel.blocks.are_records
    within = _settled(channel, LOOSE_IN_TIME if in_time else LOOSE)
    is_far = within.is_far
    counts = np.add.reduceat(is_far, channel.starts, dtype=int)
    if (counts > 1).any():
        # Several of one visit: it may have moved by more than is usual.
        moved = _settled(channel, FREE_IN_TIME if in_time else FREE).is_far
        fewer = counts - np.add.reduceat(moved, channel.starts, dtype=int) > 1
        sizes = np.diff(np.append(channel.starts, len(channel.rows)))
        fewer &= sizes > 1 + np.count_nonzero(np.any(channel.shapes, axis=0))
        is_far = np.where(fewer[channel.block], moved, is_far)
    is_far = is_far & ~_may_have_changed(is_far, channel)
    order = np.argsort(channel.rows[is_far])
    scatter = within.size * np.sqrt(within.variance[is_far])
    return _Far(
        channel.rows[is_far][order],
        channel.scale * within.off[is_far][order],
        channel.scale * scatter[order],
    )


def _settled(channel: Channel, scatter: Scatter) -> Within:
    """Weigh a channel's rows by how far they are from what the others foretell, until it settles.

    A slip drags its visit along, and with it the good rows: it has to lose its weight first.
    """
    weights = np.ones(len(channel.rows))
    within = Within(channel, scatter, weights)
    for _ in range(ROUNDS):
        if within.size == 0.0:
            break
        wanted = 1.0 / (1.0 + (within.studentised / (SOFT * within.size)) ** 2)
        if np.abs(wanted - weights).max() < SETTLED:
            break
        weights = 0.5 * (weights + wanted)
        within = Within(channel, scatter, weights)
    return within


def _may_have_changed(is_far: BoolArray, channel: Channel) -> BoolArray:
    """Find rows of the last blocks, as long as all of a block is far: they may have changed.

    With few blocks nothing is known of how they differ, and any of them may have changed.
    """
    is_whole = np.logical_and.reduceat(is_far, channel.starts)
    changed = is_whole & (len(is_whole) < FEWEST_BLOCKS)
    for at in np.argsort(channel.numbers)[::-1]:
        if not is_whole[at]:
            break
        changed[at] = True
    return changed[channel.block]


@dataclass(frozen=True, eq=False)
class Within:
    """A channel beside its loosely shifting and tilting visits, with a weight for each row."""

    channel: Channel
    loose: Scatter
    weights: FloatArray

    @cached_property
    def middle(self) -> float:
        """What visits scatter about: an outdated map may move them all."""
        return 0.0 if self.channel.blocks.free.all() else float(np.median(self.channel.values))

    @cached_property
    def state(self) -> State:
        """The weighted channel in loose visits."""
        channel, root = self.channel, np.sqrt(self.weights)
        shapes = channel.shapes * root[:, None]
        gram = [np.add.reduceat(shapes * s[:, None], channel.starts, axis=0) for s in shapes.T]
        loose = replace(
            channel,
            values=(channel.values - self.middle) * root,
            nuisance=channel.nuisance * root[:, None],
            shapes=shapes,
            gram=np.stack(gram, axis=1),
            tried=(self.loose,),
            expected=None,
            # What whitens one set of weights whitens no other.
            blocks=replace(channel.blocks),
        )
        return State(fixed_of(loose, 1), np.ones(1, dtype=bool))

    @cached_property
    def model(self) -> Model:
        """And at these variances."""
        return Model(self.state, 0)

    @cached_property
    def without_maps(self) -> FloatArray:
        """Values from the middle, without what the tables' own errors explain; shape (n,)."""
        maps = self.model.entries(self.state.fixed.channel.values)
        return np.asarray(self.channel.values - self.middle - self.channel.nuisance @ maps)

    @cached_property
    def shared(self) -> FloatArray:
        """What each block shifts and tilts by, shape (b, s)."""
        return self.model.setups(self.without_maps * np.sqrt(self.weights))

    @cached_property
    def leverage(self) -> FloatArray:
        """Variance of what shifts and tilts say at each row, over one observation's, shape (n,)."""
        channel, s = self.channel, self.channel.shapes.shape[1]
        of_block = np.zeros((len(channel.starts), s, s))
        for _, index, factor in self.state.levels.whitening.parts:
            columns = factor[0].reshape(len(index), -1, index.shape[1], s)
            of_block[index] = np.einsum("cmki,cmkj->ckij", columns, columns)
        shapes = channel.shapes
        return np.asarray(np.einsum("ni,nij,nj->n", shapes, of_block[channel.block], shapes))

    @cached_property
    def alone(self) -> FloatArray:
        """Share of a row's residual that is left with the row in the fit: one over it without."""
        # A row draws the fit to itself by w h of its residual; divided by the rest, the residual is
        # the one from a fit without the row, which need not be made.
        return np.maximum(1.0 - self.weights * self.leverage, 1e-9)

    @cached_property
    def off(self) -> FloatArray:
        """How far each row is from what the others foretell, in repeatabilities; shape (n,)."""
        fitted = np.sum(self.channel.shapes * self.shared[self.channel.block], axis=1)
        return np.asarray((self.without_maps - fitted) / self.alone)

    @cached_property
    def variance(self) -> FloatArray:
        """The variance of that, over one observation's; shape (n,)."""
        return np.asarray(1.0 + self.leverage / self.alone)

    @cached_property
    def studentised(self) -> FloatArray:
        """How far each row is, in standard deviations if the repeatability holds; shape (n,)."""
        return np.asarray(self.off / np.sqrt(self.variance))

    @property
    def is_far(self) -> BoolArray:
        """Which rows are far; values that are equal say nothing of how far the others are."""
        limit = OUTLIER * self.size if self.size > 0.0 else np.inf
        return np.asarray(np.abs(self.studentised) > limit)

    @cached_property
    def size(self) -> float:
        """Their robust scale, no less than what leans on the repeatability where that is known.

        One that was estimated contains the slips.
        """
        residuals, count = self.studentised, len(self.studentised)
        weight = self.channel.weight if self.channel.weight >= DECLARED_WEIGHT else 0.0
        spread = robust_sd(residuals - np.median(residuals)) * (1.0 + FEW / count)
        return max(spread, float(np.sqrt((weight + count * spread**2) / (weight + count))))


def _too_many(far: int, count: int) -> bool:
    """Whether so many of a channel's rows can hardly be slips."""
    return bool(bdtrc(far - 1, count, SLIPS) < TOO_MANY)


def _alike(rows: Rows, far: _Far) -> IntArray:
    """Find rows that are off by the same, in several visits, where slips would hardly be so many.

    Slips may be of any size and sign up to that of the largest.
    """
    count = len(far.rows)
    if count < FEWEST:
        return far.rows[:0]
    within = ALIKE * far.scatter
    by_chance = np.minimum(within / np.abs(far.off).max(), 1.0)
    alike = np.abs(far.off[:, None] - far.off) <= within[:, None]
    is_rare = count * bdtrc(alike.sum(axis=1) - 2, count - 1, by_chance) < ALL_ALIKE
    visits = rows.visit[far.rows]
    is_rare &= np.array([len(np.unique(visits[members])) > 1 for members in alike])
    most = int(np.argmax(is_rare * alike.sum(axis=1)))
    return np.asarray(far.rows[alike[most] & is_rare[most]], dtype=np.intp)


def _visits_apart(rows: Rows, nuisance: Sequence[Nuisance], use: BoolArray) -> list[Excluded]:
    """A slip of one visit stands alone: far from the rest and from the next furthest."""
    excluded = []
    for number in np.unique(rows.channel[use]).tolist():
        channel = _channel(rows, nuisance, number, use)
        if channel.blocks.are_records:  # what lies apart in time may be what moved
            continue
        shift = Within(channel, LOOSE, np.ones(len(channel.rows))).shared[:, 0]
        with_zero = np.flatnonzero(~channel.blocks.free)
        if len(with_zero) < FEWEST_BLOCKS:
            continue
        apart = shift[with_zero] - np.median(shift[with_zero])
        away, size = np.abs(apart), robust_sd(apart)
        order = np.argsort(away)
        first, second = away[order[-1]], away[order[-2]]
        if first > OUTLIER * max(size, 0.3) and first > SLIP_RATIO * second:
            visit = int(channel.blocks.setups[with_zero[order[-1]]])
            if visit == channel.blocks.setups.max():
                continue
            gone = sorted(channel.rows[(channel.blocks.setups == visit)[channel.block]].tolist())
            off = channel.scale * float(apart[order[-1]])
            excluded.append(
                Excluded(tuple(gone), "visit-apart", number, visit, off=(off,) * len(gone))
            )
    return excluded
