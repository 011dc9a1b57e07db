"""The straight line from which straightness counts, and what is left without it."""

from __future__ import annotations

from typing import Final, Literal, TypeAlias

import numpy as np

from app.arrays import FloatArray
from app.errors import InvalidContent
from app.units import MM_PER_M

StraightLine: TypeAlias = Literal["least-squares", "end-points"]
LINES: Final = ("least-squares", "end-points")


def expect_line(field: str, line: str, lines: tuple[str, ...] = LINES) -> None:
    """Refuse a reference line that nobody knows."""
    if line not in lines:
        raise InvalidContent.of_field(field, f"expected {' or '.join(lines)}, got {line!r}")


def line_through(positions_mm: FloatArray, line: str) -> FloatArray:
    """Give the projection of values at positions on their straight line.

    Parameters
    ----------
    positions_mm : ndarray, shape (m,) [mm]
        Increasing, at least two.
    line
        `least-squares` or `end-points`.

    Returns
    -------
    ndarray, shape (m, m)
        P, so that P @ values are the line's values.

    Examples
    --------
    >>> (line_through(np.array([0.0, 1.0, 2.0]), "end-points") @ [0.0, 5.0, 4.0]).tolist()
    [0.0, 2.0, 4.0]
    """
    # About the middle and by the length: with positions in mm far from 0 the two columns would be
    # nearly parallel.
    centred = (positions_mm - positions_mm.mean()) / np.ptp(positions_mm)
    design = np.column_stack([np.ones(centred.size), centred])
    if line == "least-squares":
        return design @ np.linalg.pinv(design)
    through = np.zeros((centred.size, centred.size))
    share = centred - centred[0]
    through[:, 0], through[:, -1] = 1 - share, share
    return through


def without_line(positions_mm: FloatArray, line: str) -> FloatArray:
    """Give the operator that takes the straight line out of values at positions.

    Parameters
    ----------
    positions_mm : ndarray, shape (m,) [mm]
        Increasing, at least two.
    line
        `least-squares` or `end-points`.

    Returns
    -------
    ndarray, shape (m, m)
        L = I − P, so that L @ values are the deviations from the line.

    Examples
    --------
    >>> (without_line(np.array([0.0, 1.0, 2.0]), "end-points") @ [0.0, 5.0, 4.0]).tolist()
    [0.0, 3.0, 0.0]
    """
    return np.eye(positions_mm.size) - line_through(positions_mm, line)


def covariance_through(operator: FloatArray, covariance: FloatArray | float) -> FloatArray:
    """Propagate a covariance through an operator such as `without_line`.

    Parameters
    ----------
    operator : ndarray, shape (k, m)
        L.
    covariance : ndarray, shape (m, m), or float [unit squared]
        C of the values; one number is the variance of values that are independent.

    Returns
    -------
    ndarray, shape (k, k) [unit squared]
        L C Lᵀ, which rounding makes neither lopsided nor negative.

    Examples
    --------
    >>> covariance_through(np.array([[1.0, -1.0]]), 0.5).tolist()
    [[1.0]]
    """
    weighted = operator * covariance if np.ndim(covariance) == 0 else operator @ covariance
    transformed = weighted @ operator.T
    transformed = (transformed + transformed.T) / 2
    np.fill_diagonal(transformed, np.maximum(np.diagonal(transformed), 0.0))
    return transformed


def slope_weights(positions_mm: FloatArray, line: str) -> FloatArray:
    """Weigh values at positions so that they give the slope of their straight line.

    Parameters
    ----------
    positions_mm : ndarray, shape (m,) [mm]
        Increasing, at least two.
    line
        `least-squares` or `end-points`.

    Returns
    -------
    ndarray, shape (m,) [1/mm]

    Examples
    --------
    >>> slope_weights(np.array([0.0, 100.0, 500.0]), "end-points").tolist()
    [-0.002, 0.0, 0.002]
    """
    if line == "least-squares":
        centred = positions_mm - positions_mm.mean()
        slope: FloatArray = centred / (centred @ centred)
        return slope
    weights = np.zeros(positions_mm.size)
    weights[[0, -1]] = -1 / np.ptp(positions_mm), 1 / np.ptp(positions_mm)
    return weights


def slope_of(positions_mm: FloatArray, values: FloatArray) -> float:
    """Give the least-squares slope of values over positions.

    Parameters
    ----------
    positions_mm : ndarray, shape (m,) [mm]
        At least two different ones.
    values : ndarray, shape (m,) [µm]

    Returns
    -------
    float [µm/m]

    Examples
    --------
    >>> slope_of(np.array([0.0, 500.0]), np.array([1.0, 2.0]))
    2.0
    """
    return float(slope_weights(positions_mm, "least-squares") @ values) * MM_PER_M
