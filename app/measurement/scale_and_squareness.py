"""Errors in a plane as scale and squareness alone: a linear map about the holes' centre."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from app.arrays import FloatArray
from app.measurement.rows_and_columns import GridFit
from app.units import MM_PER_M


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
        Their errors.
    grid
        Fit of rows and columns, whose noise is taken where there is one.
    repeatability_um
        Standard deviation of one coordinate [µm], where nothing shows the noise.

    Returns
    -------
    AffineFit

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
    freedom = len(nominal_mm) - 3
    noise = np.full(2, math.nan if repeatability_um is None else repeatability_um)
    if grid is not None:
        noise, freedom = grid.noise_um, grid.degrees_of_freedom
    elif freedom:
        noise = np.sqrt((residuals**2).sum(axis=0) / freedom)
    return AffineFit(slopes, inverse @ inverse.T, noise, freedom, residuals)
