"""One channel made ready: scaled by its repeatability, sorted by visit, its maps' freedom."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy import sparse

from app.arrays import BoolArray, FloatArray, IntArray, SparseArray
from app.search.priors import ASSUMED_SHIFT, ASSUMED_TILT, WIDE
from app.search.rows import Datum, Nuisance, Rows
from app.search.scatter import FEWEST_SETUPS, Blocks, Scatter, Whitening, scatters

LARGEST_PRIOR: Final = 1e4
"""What a standard deviation of a table entry does to the rows is cut to so many repeatabilities:
an entry that is known no better is free, and larger numbers would only lose digits."""


@dataclass(frozen=True, eq=False)
class Channel:
    """One channel's rows, in multiples of its repeatability, sorted by cell and block.

    Parameters
    ----------
    rows : ndarray, shape (n,)
        The caller's row behind each of these.
    scale
        Repeatability, in the channel's unit.
    values : ndarray, shape (n,)
        Residuals, in repeatabilities.
    nuisance : ndarray, shape (n, p)
        The tables' columns for one standard deviation of each entry: unit prior.
    shared : sparse array, shape (e, p)
        The columns' amplitudes as combinations of unit errors that channels share; columns
        that are zero have errors of their own.
    shapes : ndarray, shape (n, 1 + q)
        One and the tilt columns: what a block may do.
    starts : ndarray, shape (b,)
        First row of each block: rows of one visit at about one time.
    numbers, cells : ndarray, shape (b,)
        The block's number and the cell (fold and early or late) that it belongs to.
    gram : ndarray, shape (b, 1 + q, 1 + q)
        Shapes' products within each block.
    blocks
        How the blocks lie in time and in visits.
    tried
        Sets of variances of what rows share, L of them.
    weight
        How many observations the repeatability counts for by itself.
    expected : ndarray, shape (L,), or None
        How probable the other channels make each set of variances; None: they say nothing.
    """

    number: int
    rows: IntArray
    scale: float
    values: FloatArray
    nuisance: FloatArray
    shared: SparseArray
    shapes: FloatArray
    starts: IntArray
    numbers: IntArray
    cells: IntArray
    gram: FloatArray
    blocks: Blocks
    tried: tuple[Scatter, ...]
    weight: float
    expected: FloatArray | None = None

    def whitening(self, levels: IntArray, use: BoolArray) -> Whitening:
        """Factorise the covariance of some blocks at sets of variances that reach as far."""
        tried = tuple(self.tried[level] for level in levels.tolist())
        return self.blocks.whitening(tried, self.gram, use)

    def trying(self, which: BoolArray) -> Channel:
        """Try only some of the sets of variances, shape (L,)."""
        tried = tuple(s for s, it in zip(self.tried, which.tolist(), strict=True) if it)
        expected = None if self.expected is None else self.expected[which]
        return replace(self, tried=tried, expected=expected)

    @property
    def assumed(self) -> int:
        """Which set of variances is what is assumed before anything was measured."""
        return self.tried.index(Scatter(1.0, 1.0))

    @cached_property
    def prior(self) -> FloatArray:
        """Log prior of each set of variances, shape (L,): flat where nothing is expected."""
        return np.zeros(len(self.tried)) if self.expected is None else np.log(self.expected)

    @cached_property
    def block(self) -> IntArray:
        """Place of its block for every row."""
        counts = np.diff(np.append(self.starts, len(self.rows)))
        return np.repeat(np.arange(len(self.starts)), counts)

    @cached_property
    def given(self) -> FloatArray:
        """The tables' columns and the values, side by side, shape (n, p + 1)."""
        return np.column_stack([self.nuisance, self.values])

    def reduce(self, columns: FloatArray) -> FloatArray:
        """Sum columns within each block, weighted with each of its shapes.

        Parameters
        ----------
        columns : ndarray, shape (n, m)

        Returns
        -------
        ndarray, shape (b, 1 + q, m)
        """
        reduced = np.asarray(self._of_blocks @ columns)
        return reduced.reshape(len(self.starts), self.shapes.shape[1], columns.shape[1])

    @cached_property
    def _of_blocks(self) -> SparseArray:
        """Each block's shapes as rows, shape (b (1 + q), n)."""
        (n, shapes), blocks = self.shapes.shape, len(self.starts)
        place = shapes * self.block[:, None] + np.arange(shapes)
        rows = np.repeat(np.arange(n), shapes)
        size = (blocks * shapes, n)
        return sparse.csr_array((self.shapes.ravel(), (place.ravel(), rows)), shape=size)

    def by_cell(self, left: FloatArray, right: FloatArray, cells: int) -> FloatArray:
        """Multiply two sets of columns within each cell of blocks.

        Parameters
        ----------
        left : ndarray, shape (n, m)
        right : ndarray, shape (n, k)

        Returns
        -------
        ndarray, shape (cells, m, k)
        """
        products = np.zeros((cells, left.shape[1], right.shape[1]))
        for cell, part in self.parts:
            products[cell] = left[part].T @ right[part]
        return products

    @cached_property
    def parts(self) -> list[tuple[int, slice]]:
        """The cells that have rows, and which these are."""
        begins = np.flatnonzero(np.append(True, np.diff(self.cells) != 0))
        bounds = [*self.starts[begins].tolist(), len(self.rows)]
        return list(zip(self.cells[begins].tolist(), map(slice, bounds, bounds[1:]), strict=False))


def prepare(
    rows: Rows,
    nuisance: Sequence[Nuisance],
    number: int,
    scale: float,
    weight: float,
    use: BoolArray,
    cell_of: dict[int, int],
) -> Channel:
    """Make one channel ready.

    Parameters
    ----------
    scale, weight
        Its repeatability, and how many observations that counts for by itself.
    use : ndarray, shape (n,)
        Which rows take part.
    """
    index = _sorted_rows(rows, np.flatnonzero((rows.channel == number) & use), cell_of)
    starts = np.flatnonzero(np.append(True, np.diff(rows.block[index]) != 0)).astype(np.intp)
    numbers = rows.block[index[starts]]
    shapes = np.column_stack([np.ones(len(index)), rows.tilt[index]])
    blocks = _blocks(rows, index, starts)
    gram = np.stack(
        [np.add.reduceat(shapes * s[:, None], starts, axis=0) for s in shapes.T], axis=1
    )
    return Channel(
        number=number,
        rows=index,
        scale=scale,
        values=_without_free_constants(rows.values[index] / scale, blocks, starts),
        nuisance=unit_prior_columns(nuisance, number, index, scale),
        shared=shared_errors(nuisance, number),
        shapes=shapes,
        starts=starts,
        numbers=numbers,
        cells=np.array([cell_of[int(b)] for b in numbers], dtype=np.intp),
        gram=gram,
        blocks=blocks,
        tried=scatters(blocks),
        weight=weight,
    )


def _sorted_rows(rows: Rows, index: IntArray, cell_of: dict[int, int]) -> IntArray:
    """Sort by content, so that the caller's order decides nothing."""
    block = rows.block[index]
    cells = np.array([cell_of[int(b)] for b in block])
    tilt = tuple(rows.tilt[index].T)
    order = np.lexsort((rows.replicate[index], rows.values[index], *tilt, block, cells))
    return index[order].astype(np.intp)


def _blocks(rows: Rows, index: IntArray, starts: IntArray) -> Blocks:
    """Say how blocks lie in time and what is expected of their set-ups."""
    visits, number = rows.visit[index[starts]], int(rows.channel[index[0]])
    counts = np.diff(np.append(starts, len(index)))
    zeros = [rows.datum.get((int(v), number), Datum.ABSOLUTE) for v in visits]
    tilts = rows.tilt.shape[1]
    setups = len(np.unique(visits))
    is_own_unknown = setups < min(len(visits), FEWEST_SETUPS)
    variances = np.append(ASSUMED_SHIFT, np.full(tilts, ASSUMED_TILT)) ** 2
    return Blocks(
        setups=visits,
        minutes=np.add.reduceat(rows.minutes[index], starts) / counts,
        free=np.array([zero is not Datum.ABSOLUTE for zero in zeros]),
        own=np.full(1 + tilts, WIDE) if is_own_unknown else variances,
        # It tilts as much beside its shift as set-ups do.
        wander=variances / variances[0],
        is_own_unknown=is_own_unknown,
    )


def _without_free_constants(values: FloatArray, blocks: Blocks, starts: IntArray) -> FloatArray:
    """Take off the means that carry nothing: no precision is lost on them later."""
    counts = np.diff(np.append(starts, len(values)))
    of_setup = np.unique(blocks.setups, return_inverse=True)[1]
    sums = np.bincount(of_setup, weights=np.add.reduceat(values, starts))
    means = (sums / np.bincount(of_setup, weights=counts))[of_setup]
    return np.asarray(values - np.repeat(np.where(blocks.free, means, 0.0), counts))


def shared_errors(
    nuisance: Sequence[Nuisance], number: int, count: int | None = None
) -> SparseArray:
    """Set the shared errors of a channel's columns side by side.

    Parameters
    ----------
    count
        How many errors are shared at all; None: as many as any of these has.
    """
    of_channel = [entry_set for entry_set in nuisance if entry_set.channel == number]
    if count is None:
        count = max(
            (entry_set.shared.shape[0] for entry_set in nuisance if entry_set.shared is not None),
            default=0,
        )
    blocks = [
        sparse.csr_array((count, entry_set.columns.shape[1]))
        if entry_set.shared is None
        else entry_set.shared
        for entry_set in of_channel
    ]
    return sparse.hstack([sparse.csr_array((count, 0)), *blocks], format="csr")


def unit_prior_columns(
    nuisance: Sequence[Nuisance], number: int, index: IntArray, scale: float
) -> FloatArray:
    """Lay a channel's columns out over its rows, in repeatabilities for a prior of one.

    Parameters
    ----------
    index : ndarray, shape (m,)
        The channel's rows.

    Returns
    -------
    ndarray, shape (m, p)
    """
    blocks = [np.zeros((len(index), 0))]
    for entry_set in nuisance:
        if entry_set.channel == number:
            columns = entry_set.at(index) / scale
            size = np.sqrt(np.mean(columns**2, axis=0))
            blocks.append(columns / np.maximum(size / LARGEST_PRIOR, 1.0))
    return np.hstack(blocks)
