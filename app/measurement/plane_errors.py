"""Errors in a plane taken apart: rigid motion, scale and squareness, errors of rows and columns.

References
----------
P. H. Schönemann, *A generalized solution of the orthogonal Procrustes problem*,
Psychometrika 31, 1–10 (1966), for the rigid motion; in the plane, the argument of one
complex sum.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.arrays import FloatArray, IntArray
from app.errors import InvalidContent
from app.thermal.error_map import LARGEST_ERROR_UM
from app.units import MM_PER_M, UM_PER_MM, URAD_PER_RAD

ComplexArray = NDArray[np.complex128]

UNTURNED: Final = 1e-6
"""Least size of a sum that has an argument [mm²]."""


DECIMALS: Final = 6
"""Of nominal coordinates in mm that are the same row or column."""


class RigidMotion(NamedTuple):
    """How a plate lay, and the holes' errors without it."""

    rotation_urad: float
    shift_mm: FloatArray
    errors_um: FloatArray


def take_out_rigid_motion(nominal_mm: FloatArray, measured_mm: FloatArray) -> RigidMotion:
    """Fit shift and rotation by least squares, and take them out.

    Parameters
    ----------
    nominal_mm, measured_mm : ndarray, shape (n, 2) [mm]
        Nominal and measured x, y of the same holes.

    Returns
    -------
    RigidMotion
        The rotation about Z by the right-hand rule, the place of the nominal zero, and the
        errors in the nominal directions.

    Raises
    ------
    InvalidContent
        If a hole remains more than 10 mm beside its nominal place.

    Notes
    -----
    With both sets counted from their means, the rotation is the argument of Σ n̄ m: exact,
    not linearised.

    Examples
    --------
    >>> square = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [0.0, 100.0]])
    >>> turned = square @ [[0.0, 1.0], [-1.0, 0.0]] + [5.0, 7.0]
    >>> motion = take_out_rigid_motion(square, turned)
    >>> round(motion.rotation_urad), motion.shift_mm.round(9).tolist()
    (1570796, [5.0, 7.0])
    """
    n, m = _complex(nominal_mm), _complex(measured_mm)
    n_mean, m_mean = n.mean(), m.mean()
    n, m = n - n_mean, m - m_mean
    # Σ |m − e^(iφ) n|² is least where e^(−iφ) Σ n̄ m is real and above 0.
    turned = np.vdot(n, m)
    # Holes on one spot show no rotation: none is taken out.
    turn = turned / abs(turned) if abs(turned) > 0 else 1.0 + 0.0j
    errors = m * np.conj(turn) - n
    _expect_small(errors, n, m)
    shift = m_mean - turn * n_mean
    return RigidMotion(
        rotation_urad=float(np.angle(turn)) * URAD_PER_RAD,
        shift_mm=np.array([shift.real, shift.imag]),
        errors_um=np.column_stack([errors.real, errors.imag]) * UM_PER_MM,
    )


def _complex(points: FloatArray) -> ComplexArray:
    return points[:, 0] + 1j * points[:, 1]


def _expect_small(errors_mm: ComplexArray, n: ComplexArray, m: ComplexArray) -> None:
    worst = int(np.abs(errors_mm).argmax())
    if abs(errors_mm[worst]) * UM_PER_MM <= LARGEST_ERROR_UM:
        return
    # No rotation makes a mirrored plate fit: if its mirror image fits, that is what is wrong.
    seen_from_behind = np.conj(n)
    turned = np.vdot(seen_from_behind, m)
    residuals = np.abs(m * np.conj(turned) / max(abs(turned), UNTURNED) - seen_from_behind)
    perhaps = (
        "mirrored (seen from the other side, or x and y exchanged)"
        if residuals.max() * UM_PER_MM <= LARGEST_ERROR_UM
        else "in another order or another unit"
    )
    raise InvalidContent.of_field(
        "measured_mm",
        f"expected each hole within {LARGEST_ERROR_UM / UM_PER_MM:g} mm of its nominal place after "
        f"a shift and a rotation, got {abs(errors_mm[worst]):.3g} mm at index {worst}: perhaps "
        f"{perhaps}",
    )


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
    # A constant can go from all columns to all rows, so that the rank is one less: some share of it
    # is taken here, and `_centred` takes it out of both.
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
    # A hole that goes may leave another one alone in its row: until none goes.
    remaining = np.arange(len(rounded))
    while remaining.size:
        alone = np.zeros(remaining.size, dtype=bool)
        for coordinate in rounded[remaining].T:
            _, place, count = np.unique(coordinate, return_inverse=True, return_counts=True)
            alone |= count[place] < 2
        if not alone.any():
            break
        remaining = remaining[~alone]
    return remaining


def _centred(operator: FloatArray, holes: IntArray) -> FloatArray:
    """Take the mean over the holes out of a part."""
    mean: FloatArray = holes @ operator / holes.sum()
    return operator - mean


class AffineFit(NamedTuple):
    """e = slopes · (x, y) about the plate's centre: rows of slopes e_x, e_y [µm/mm].

    `unit_covariance` is the covariance of each row for σ = 1 µm, and `noise_um` σ of e_x
    and of e_y, NaN where nothing is known.
    """

    slopes: FloatArray
    unit_covariance: FloatArray
    noise_um: FloatArray
    degrees_of_freedom: int
    residuals_um: FloatArray

    @property
    def scale_um_per_m(self) -> FloatArray:
        """Scale of x and of y."""
        return np.diagonal(self.slopes) * MM_PER_M

    @property
    def scale_standard_errors_um_per_m(self) -> FloatArray:
        """Their standard errors."""
        return self.noise_um * np.sqrt(np.diagonal(self.unit_covariance)) * MM_PER_M


def fit_scale_and_squareness(
    nominal_mm: FloatArray,
    errors_um: FloatArray,
    grid: GridFit | None,
    repeatability_um: float | None,
) -> AffineFit:
    """Fit the linear map of the holes' errors by least squares.

    Parameters
    ----------
    nominal_mm : ndarray, shape (n, 2) [mm]
        Nominal x, y of the holes, not on one line.
    errors_um : ndarray, shape (n, 2) [µm]
    repeatability_um
        Standard deviation of one coordinate [µm], where nothing shows the noise.

    Examples
    --------
    >>> corners = np.array([[0.0, 0.0], [200.0, 0.0], [0.0, 100.0], [200.0, 100.0]])
    >>> errors = np.array([[0.0, 0.0], [4.0, 0.0], [1.0, 0.0], [5.0, 0.0]])
    >>> fit_scale_and_squareness(corners, errors, None, None).scale_um_per_m.round(9).tolist()
    [20.0, 0.0]
    """
    centred = nominal_mm - nominal_mm.mean(axis=0)
    inverse = np.linalg.pinv(centred)
    slopes = (inverse @ errors_um).T
    residuals = errors_um - centred @ slopes.T
    # Of each coordinate: two slopes, and the shift that went with the rigid motion, whose rotation
    # is in the slopes.
    freedom = len(nominal_mm) - 3
    noise = np.full(2, math.nan if repeatability_um is None else repeatability_um)
    if grid is not None:
        noise, freedom = grid.noise_um, grid.degrees_of_freedom
    elif freedom:
        noise = np.sqrt((residuals**2).sum(axis=0) / freedom)
    return AffineFit(slopes, inverse @ inverse.T, noise, freedom, residuals)
