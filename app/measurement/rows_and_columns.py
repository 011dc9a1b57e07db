"""Errors in a plane as a part that goes with the column plus one that goes with the row."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from app.arrays import FloatArray, IntArray

DECIMALS: Final = 6
"""Of nominal coordinates in mm that are the same row or column."""


class GridFit(NamedTuple):
    """e_x and e_y as a part that goes with the column (x) plus one that goes with the row (y).

    `operators[u]` turns the errors of the `holes` into the part along u, 0 for x and 1
    for y, free of a constant; `coordinates_mm[u]` are the columns' x and the rows' y.
    """

    coordinates_mm: tuple[FloatArray, FloatArray]
    operators: tuple[FloatArray, FloatArray]
    holes: IntArray
    noise_um: FloatArray
    degrees_of_freedom: int
    residuals_um: FloatArray


def fit_rows_and_columns(nominal_mm: FloatArray, errors_um: FloatArray) -> GridFit | None:
    """Fit a part for each column and each row of holes.

    Parameters
    ----------
    nominal_mm : ndarray, shape (n, 2) [mm]
        Nominal x, y of the holes.
    errors_um : ndarray, shape (n, 2) [µm]
        Their errors.

    Returns
    -------
    GridFit or None
        None where fewer than half of the holes share both their column and their row with
        others, or where columns and rows do not hang together.

    Examples
    --------
    >>> corners = np.array([[0.0, 0.0], [200.0, 0.0], [0.0, 100.0], [200.0, 100.0]])
    >>> fit = fit_rows_and_columns(corners, np.array([[0.0, 0], [4.0, 0], [1.0, 0], [5.0, 0]]))
    >>> (fit.operators[0] @ [0.0, 4.0, 1.0, 5.0]).round(9).tolist(), fit.degrees_of_freedom
    ([-2.0, 2.0], 1)
    """
    rounded = np.round(nominal_mm, DECIMALS)
    holes = _on_rows_and_columns(rounded)
    if 2 * holes.size < len(nominal_mm) or holes.size == 0:
        return None
    columns, column = np.unique(rounded[holes, 0], return_inverse=True)
    rows, row = np.unique(rounded[holes, 1], return_inverse=True)
    design = np.hstack([np.eye(columns.size)[column], np.eye(rows.size)[row]])
    # Columns and rows that do not hang together would each have a zero of their own.
    if np.linalg.matrix_rank(design) < columns.size + rows.size - 1:
        return None
    inverse = np.linalg.pinv(design).astype(np.float64)
    residuals = errors_um[holes] - design @ (inverse @ errors_um[holes])
    freedom = holes.size - (columns.size + rows.size - 1)
    return GridFit(
        coordinates_mm=(columns, rows),
        operators=(
            _centred(inverse[: columns.size], np.bincount(column)),
            _centred(inverse[columns.size :], np.bincount(row)),
        ),
        holes=holes,
        noise_um=np.sqrt((residuals**2).sum(axis=0) / freedom),
        degrees_of_freedom=freedom,
        residuals_um=residuals,
    )


def _on_rows_and_columns(rounded: FloatArray) -> IntArray:
    """Keep holes that share their column and their row with another kept hole."""
    kept = np.arange(len(rounded))
    while kept.size:
        alone = np.zeros(kept.size, dtype=bool)
        for coordinate in rounded[kept].T:
            _, place, count = np.unique(coordinate, return_inverse=True, return_counts=True)
            alone |= count[place] < 2
        if not alone.any():
            break
        kept = kept[~alone]
    return kept


def _centred(operator: FloatArray, holes: IntArray) -> FloatArray:
    """Take the mean over the holes out of a part."""
    mean: FloatArray = holes @ operator / holes.sum()
    return operator - mean
