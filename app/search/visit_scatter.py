"""How far a visit may be shifted and tilted: the part of the noise that points do not average."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.arrays import FloatArray

FEWEST_VISITS: Final = 8
"""Fewer visits say nothing about what differs between visits."""

TIED: Final = (0.0, 0.3, 1.0, 4.0, 16.0, 80.0, 400.0)
"""Multiples of the declared variances of shift and tilt, tried together."""

APART: Final = ((16.0, 1.0), (200.0, 1.0), (1.0, 16.0), (1.0, 200.0))
"""(shift, tilt), tried apart: a machine may be re-levelled without being turned."""

UNLIMITED: Final = 1e6
"""Variance of a constant that nobody knows, over the variance of one observation."""

DECADE: Final = 10.0
"""A declared variance is believed within such a factor (one standard deviation)."""


def multipliers(tilts: int, shifted: bool = True) -> FloatArray:
    """List the multiples of (shift, tilt) variance over which the likelihood is profiled.

    Parameters
    ----------
    tilts
        Number of tilt columns; without any, shift and tilt need not be told apart.
    shifted
        Whether any visit's shift is limited: a free constant has no variance to estimate.

    Returns
    -------
    ndarray, shape (L, 2)

    Examples
    --------
    >>> len(multipliers(0)), len(multipliers(2))
    (7, 11)
    """
    tied = [(m, m) for m in TIED]
    return np.array(tied if tilts == 0 or not shifted else [*tied, *APART])


def log_prior(scale: FloatArray) -> FloatArray:
    """Say how well multiples agree with what was declared (log density, 0 at one).

    Parameters
    ----------
    scale : ndarray, shape (L, 2)
        Multiples of the declared variances.

    Returns
    -------
    ndarray, shape (L,)
    """
    decades = np.log(np.maximum(scale, TIED[1] / DECADE)) / np.log(DECADE)
    return np.asarray(-0.5 * np.mean(decades**2, axis=1))


def factors(gram: FloatArray, variances: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Factorise the covariance of all visits in closed form.

    A visit's covariance is V = I + Z D Z'. With L L' = I + D½ Z'Z D½ and F = L⁻¹ D½,
    V⁻¹ = I − (F Z')'(F Z') and log det V = 2 Σ log diag L: nothing of the size of the
    rows squared is ever formed.

    Parameters
    ----------
    gram : ndarray, shape (b, q, q)
        Z'Z of each visit.
    variances : ndarray, shape (b, q)
        D of each visit, over the variance of one observation.

    Returns
    -------
    factor : ndarray, shape (b, q, q)
    log_determinant : ndarray, shape (b,)

    Examples
    --------
    >>> f, log_det = factors(np.array([[[3.0]]]), np.array([[2.0]]))
    >>> round(float(np.exp(log_det[0])), 9)      # det(I + 2·11') of three rows
    7.0
    """
    root = np.sqrt(variances)
    inner = root[:, :, None] * gram * root[:, None, :] + np.eye(gram.shape[1])
    lower = np.linalg.cholesky(inner)
    factor = np.linalg.solve(lower, root[:, :, None] * np.eye(gram.shape[1]))
    log_det = 2.0 * np.log(np.diagonal(lower, axis1=1, axis2=2)).sum(axis=1)
    return factor, log_det
