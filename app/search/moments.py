"""Products of columns with everything that is fixed in a channel: the rows are read once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.arrays import FloatArray
from app.search.channel import Channel


@dataclass(frozen=True, eq=False)
class Moments:
    """Products of some columns A with the nuisance J, the values y and the visits' shapes Z.

    Parameters
    ----------
    nuisance : ndarray, shape (cells, m, p)
        A'J within each cell.
    values : ndarray, shape (cells, m)
        A'y within each cell.
    reduced : ndarray, shape (b, 1 + q, m)
        Z'A within each visit.
    """

    nuisance: FloatArray
    values: FloatArray
    reduced: FloatArray


@dataclass(frozen=True, eq=False)
class Fixed:
    """A channel and the products among what no candidate changes.

    Parameters
    ----------
    nuisance
        Products of J; its own `nuisance` is J'J.
    values
        Products of y, as a single column.
    square : ndarray, shape (cells,)
        y'y within each cell.
    """

    channel: Channel
    cells: int
    nuisance: Moments
    values: Moments
    square: FloatArray


def moments_of(channel: Channel, columns: FloatArray, cells: int | None) -> Moments:
    """Multiply columns with everything that is fixed in a channel.

    Parameters
    ----------
    columns : ndarray, shape (n, m)
        In its order of rows, in repeatabilities.
    cells
        How many cells are kept apart; None: all rows are one.
    """
    products = (
        (columns.T @ channel.given)[None]
        if cells is None
        else channel.by_cell(columns, channel.given, cells)
    )
    return Moments(products[..., :-1], products[..., -1], channel.reduce(columns))


def fixed_of(channel: Channel, cells: int) -> Fixed:
    """Multiply what no candidate changes with itself."""
    both = moments_of(channel, channel.given, cells)
    nuisance, values = (
        Moments(both.nuisance[:, chosen], both.values[:, chosen], both.reduced[..., chosen])
        for chosen in (slice(-1), slice(-1, None))
    )
    return Fixed(channel, cells, nuisance, values, both.values[:, -1])


def blocks(columns: FloatArray, k: int) -> FloatArray:
    """Multiply each entry's k columns with each other.

    Parameters
    ----------
    columns : ndarray, shape (..., n, g k)

    Returns
    -------
    ndarray, shape (..., g, k, k)

    Examples
    --------
    >>> blocks(np.array([[1.0, 2.0], [0.0, 3.0]]), 2).tolist()
    [[[1.0, 2.0], [2.0, 13.0]]]
    """
    width = columns.shape[-1]
    matrices = np.empty((*columns.shape[:-2], width // k, k, k))
    for apart in range(k):
        # All columns that are so far apart, also of two entries: memory is read as it lies.
        left, right = columns[..., : width - apart], columns[..., apart:]
        products = np.einsum("...ng,...ng->...g", left, right)
        for i in range(k - apart):
            matrices[..., i, i + apart] = matrices[..., i + apart, i] = products[..., i::k]
    return matrices
