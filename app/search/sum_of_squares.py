"""How surprising the size of some values is, of which covariance is known but for a scale.

D. Kuonen, Biometrika 86 (1999) 929: the tail of a quadratic form by a saddlepoint.
R. Lugannani, S. Rice, Adv. Appl. Probab. 12 (1980) 475: its formula.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.optimize import brentq
from scipy.special import gammaincinv, ndtr

from app.arrays import FloatArray

NODES: Final = np.linspace(-5.0, 5.0, 41)
"""Normal deviates at which the estimated scale's own distribution is evaluated."""

NEAR_THE_MEAN: Final = 1.000001
"""Totals below so many times the mean surprise nobody: there the formula divides 0 by 0."""

CLOSE: Final = 1e-9
"""Share of the way to where the cumulant function ends."""


def surprise_of_squares(
    total: float, noise: float, freedom: float, spread: FloatArray, others: FloatArray, count: int
) -> float:
    """Give the probability that n values are as large as they are, or larger.

    They are x ~ N(0, σ² (z I + S S') + D D'), of which σ is known as an estimate alone: the
    probability is averaged over what σ may be. Of D = S = 0 that is the F test.

    Parameters
    ----------
    total
        x'x.
    noise, freedom
        The estimate of z σ², and its degrees of freedom.
    spread : ndarray, shape (n, a)
        S, over the root of z.
    others : ndarray, shape (n, b)
        D.
    count
        n.

    Examples
    --------
    >>> from scipy.stats import f
    >>> none = np.zeros((4, 0))
    >>> round(surprise_of_squares(40.0, 1.0, 10.0, none, none, 4), 4)
    0.0017
    >>> round(float(f.sf(10.0, 4, 10)), 4)
    0.0016
    """
    weights = np.exp(-0.5 * NODES**2)
    tail = 0.0
    for weight, scale in zip(weights / weights.sum(), _scales(freedom), strict=True):
        level = noise * float(scale)
        columns = np.hstack([np.sqrt(level) * spread, others])
        # C C', of n values, has the eigenvalues of the smaller C'C and zeros else; of more columns
        # than values the n largest are all.
        shared = np.linalg.eigvalsh(columns.T @ columns)[::-1][:count].clip(min=0.0)
        variances = np.append(level + shared, level)
        counts = np.append(np.ones(len(shared)), max(count - len(shared), 0))
        tail += weight * tail_of_squares(total, variances, counts)
    return float(tail)


def _scales(freedom: float) -> FloatArray:
    """Give what σ² may be over its estimate, at each node."""
    return np.asarray(0.5 * freedom / gammaincinv(0.5 * freedom, ndtr(NODES)))


def tail_of_squares(total: float, variances: FloatArray, counts: FloatArray) -> float:
    """Give the probability that Σ λ χ² exceeds a value, 1 below its mean.

    Parameters
    ----------
    variances, counts : ndarray, shape (k,)
        λ, above 0, and the degrees of freedom of each χ².

    Examples
    --------
    >>> round(tail_of_squares(9.0, np.array([1.0]), np.array([1.0])), 4)    # of 0.0027
    0.0029
    >>> tail_of_squares(1.0, np.array([1.0]), np.array([2.0]))
    1.0
    """
    mean = float(counts @ variances)
    if total <= NEAR_THE_MEAN * mean:
        return 1.0

    def slope(t: float) -> float:
        return float(counts @ (variances / (1.0 - 2.0 * t * variances))) - total

    # The cumulant function K(t) = −½ Σ n ln(1 − 2 t λ) ends there. The saddlepoint is where its
    # slope is the total; a total that is beyond the slope even at the end has a probability of
    # nothing.
    end = 0.5 / float(variances[counts > 0].max()) * (1.0 - CLOSE)
    if slope(end) <= 0.0:
        return 0.0
    at = float(brentq(slope, 0.0, end))
    bent = 1.0 - 2.0 * at * variances
    height = -0.5 * float(counts @ np.log(np.where(counts > 0, bent, 1.0)))
    width = 2.0 * float(counts @ (variances / bent) ** 2)
    w = float(np.sqrt(max(2.0 * (at * total - height), 0.0)))
    v = at * float(np.sqrt(width))
    if w < 1e-4 or v <= 0.0:
        return 1.0
    # Both terms of Lugannani and Rice as one deviate: their difference could leave 0 to 1.
    return float(np.clip(ndtr(-w - np.log(v / w) / w), 0.0, 1.0))
