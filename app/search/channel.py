"""One channel made ready: scaled by its repeatability, sorted by visit, its maps' freedom."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import sparse

from app.arrays import BoolArray, FloatArray, IntArray, SparseArray
from app.search.rows import Datum, DeclaredNoise, Nuisance, Rows
from app.search.visit_scatter import UNLIMITED, log_prior, multipliers

DECLARED_WEIGHT: Final = 20.0
"""A declared repeatability counts as much as so many repeated observations."""

ESTIMATED_WEIGHT: Final = 2.0
"""One that was estimated from the same rows only keeps small samples from certainty."""

ASSUMED_SHIFT, ASSUMED_TILT = 0.5, 0.3
"""Where the search for an undeclared set-up scatter starts, in repeatabilities."""

POOLED_WEIGHT: Final = 10.0
"""One that leans on the replicates of channels that are alike."""

FREE_PRIOR: Final = 1e4
"""An entirely free table entry, in repeatabilities of what it does to the rows."""


@dataclass(frozen=True, eq=False)
class Channel:
    """One channel's rows, in multiples of its repeatability, sorted by cell and visit.

    Parameters
    ----------
    number
        The caller's number of the channel.
    rows : ndarray, shape (n,)
        The caller's row behind each of these.
    scale
        Repeatability, in the channel's unit.
    values : ndarray, shape (n,)
        Residuals, in repeatabilities.
    nuisance : ndarray, shape (n, p)
        The tables' columns, each times its prior standard deviation: unit prior.
    shared : sparse array, shape (e, p)
        The columns' amplitudes as combinations of unit errors that channels share; columns
        that are zero have errors of their own.
    shapes : ndarray, shape (n, 1 + q)
        One and the tilt columns: what a visit may do.
    starts : ndarray, shape (b,)
        First row of each visit.
    visits, cells : ndarray, shape (b,)
        The visit's number and the cell (fold and early or late) that it belongs to.
    gram : ndarray, shape (b, 1 + q, 1 + q)
        Shapes' products within each visit.
    variances : ndarray, shape (L, b, 1 + q)
        Variances of a visit's shapes for each set of multipliers.
    prior : ndarray, shape (L,)
        Log prior of the multipliers: flat where nothing is declared.
    declared
        Which multipliers are what was declared.
    weight
        How many observations the repeatability counts for by itself.
    free : ndarray, shape (b,)
        Visits whose zero is unknown.
    """

    number: int
    rows: IntArray
    scale: float
    values: FloatArray
    nuisance: FloatArray
    shared: SparseArray
    shapes: FloatArray
    starts: IntArray
    visits: IntArray
    cells: IntArray
    gram: FloatArray
    variances: FloatArray
    prior: FloatArray
    declared: int
    weight: float
    free: BoolArray

    @property
    def block(self) -> IntArray:
        """Number of the visit's block of every row."""
        counts = np.diff(np.append(self.starts, len(self.rows)))
        return np.repeat(np.arange(len(self.starts)), counts)

    def reduce(self, columns: FloatArray) -> FloatArray:
        """Sum columns within each visit, weighted with each of its shapes.

        Parameters
        ----------
        columns : ndarray, shape (n, m)

        Returns
        -------
        ndarray, shape (b, 1 + q, m)
        """
        sums = [
            np.add.reduceat(shape[:, None] * columns, self.starts, axis=0)
            for shape in self.shapes.T
        ]
        return np.stack(sums, axis=1)

    def by_cell(self, left: FloatArray, right: FloatArray, cells: int) -> FloatArray:
        """Multiply two sets of columns within each cell of visits.

        Parameters
        ----------
        left : ndarray, shape (n, m)
        right : ndarray, shape (n, k)
        cells
            How many cells there are.

        Returns
        -------
        ndarray, shape (cells, m, k)
        """
        bounds = self.starts[
            np.searchsorted(self.cells, np.arange(cells)).clip(max=len(self.cells) - 1)
        ]
        ends = np.searchsorted(self.cells, np.arange(cells), side="right")
        stops = np.append(self.starts, len(self.rows))[ends]
        found = np.zeros((cells, left.shape[1], right.shape[1]))
        for cell in np.unique(self.cells):
            part = slice(bounds[cell], stops[cell])
            found[cell] = left[part].T @ right[part]
        return found


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
    rows, nuisance
        As the caller gives them.
    number
        The channel.
    scale, weight
        Its repeatability, and how many observations that counts for by itself.
    use : ndarray, shape (n,)
        Which rows take part.
    cell_of
        Visit to cell.

    Returns
    -------
    Channel
    """
    index = _sorted_rows(rows, np.flatnonzero((rows.channel == number) & use), cell_of)
    visits, starts = _blocks(rows.visit[index])
    noise = rows.noise.get(number, DeclaredNoise())
    free = np.array(
        [rows.datum.get((int(v), number), Datum.ABSOLUTE) != Datum.ABSOLUTE for v in visits]
    )
    shapes = np.column_stack([np.ones(len(index)), rows.tilt[index]])
    scales = multipliers(rows.tilt.shape[1], not bool(free.all()))
    variances = _variances(noise, scale, free, scales, rows.tilt.shape[1])
    gram = np.stack(
        [np.add.reduceat(shapes * s[:, None], starts, axis=0) for s in shapes.T], axis=1
    )
    known = noise.setup_shift is not None
    return Channel(
        number=number,
        rows=index,
        scale=scale,
        values=_without_free_constants(rows.values[index] / scale, starts, free),
        nuisance=_unit_prior_columns(nuisance, number, index, len(rows.values), scale),
        shared=_shared(nuisance, number),
        shapes=shapes,
        starts=starts,
        visits=visits,
        cells=np.array([cell_of[int(v)] for v in visits], dtype=np.intp),
        gram=gram,
        variances=variances,
        prior=log_prior(scales) if known else np.zeros(len(scales)),
        declared=int(np.flatnonzero((scales == 1.0).all(axis=1))[0]),
        weight=weight,
        free=free,
    )


def _sorted_rows(rows: Rows, index: IntArray, cell_of: dict[int, int]) -> IntArray:
    """Sort by content, so that the caller's order decides nothing."""
    cells = np.array([cell_of[int(v)] for v in rows.visit[index]])
    tilt = tuple(rows.tilt[index].T)
    order = np.lexsort((rows.replicate[index], rows.values[index], *tilt, rows.visit[index], cells))
    return index[order].astype(np.intp)


def _blocks(visit: IntArray) -> tuple[IntArray, IntArray]:
    starts = np.flatnonzero(np.append(True, np.diff(visit) != 0)).astype(np.intp)
    return visit[starts].astype(np.intp), starts


def _variances(
    noise: DeclaredNoise, scale: float, free: BoolArray, scales: FloatArray, tilts: int
) -> FloatArray:
    shift = ASSUMED_SHIFT if noise.setup_shift is None else noise.setup_shift / scale
    tilt = ASSUMED_TILT if noise.setup_tilt is None else np.asarray(noise.setup_tilt) / scale
    found = np.empty((len(scales), len(free), 1 + tilts))
    found[:, :, 0] = np.where(free, UNLIMITED, scales[:, :1] * shift**2)
    found[:, :, 1:] = scales[:, 1:, None] * np.broadcast_to(tilt, tilts) ** 2
    return found


def _without_free_constants(values: FloatArray, starts: IntArray, free: BoolArray) -> FloatArray:
    """Take off the means that carry nothing: no precision is lost on them later."""
    counts = np.diff(np.append(starts, len(values)))
    means = np.add.reduceat(values, starts) / counts
    return np.asarray(values - np.repeat(np.where(free, means, 0.0), counts))


def _shared(nuisance: Sequence[Nuisance], number: int) -> SparseArray:
    """Set the shared errors of a channel's columns side by side."""
    own = [one for one in nuisance if one.channel == number]
    count = max((one.shared.shape[0] for one in nuisance if one.shared is not None), default=0)
    blocks = [
        sparse.csr_array((count, len(one.prior))) if one.shared is None else one.shared
        for one in own
    ]
    return sparse.hstack([sparse.csr_array((count, 0)), *blocks], format="csr")


def _unit_prior_columns(
    nuisance: Sequence[Nuisance], number: int, index: IntArray, n: int, scale: float
) -> FloatArray:
    place = np.full(n, -1, dtype=np.intp)
    place[index] = np.arange(len(index))
    blocks = [np.zeros((len(index), 0))]
    for one in nuisance:
        if one.channel == number:
            here = place[one.rows]
            full = np.zeros((len(index), len(one.prior)))
            full[here[here >= 0]] = one.columns[here >= 0]
            norm = np.sqrt(np.mean(full**2, axis=0))
            free = FREE_PRIOR * scale / np.where(norm > 0, norm, 1.0)
            blocks.append(full * np.minimum(one.prior, free) / scale)
    return np.hstack(blocks)
