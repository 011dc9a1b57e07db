"""Correlation of few values: its interval, and when two correlations differ.

References
----------
R. A. Fisher, *On the probable error of a coefficient of correlation*, Metron 1, 3-32
(1921). E. J. Williams, *The comparison of regression variables*, J. R. Stat. Soc. B 21,
396-399 (1959). J. H. Steiger, *Tests for comparing elements of a correlation matrix*,
Psychol. Bull. 87, 245-251 (1980).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from scipy.special import ndtri, stdtrit

from app.arrays import FloatArray

CONFIDENCE: Final = 0.95
"""Of the interval of r, and one minus the level at which two correlations differ."""

ENOUGH: Final = 4
"""Fewer pairs leave Fisher's interval and Williams' test no degree of freedom."""

ROUNDING: Final = 1e-9
"""A difference of two correlations that is none."""


def pearson_r(first: FloatArray, other: FloatArray) -> float:
    """Compute Pearson's correlation of two quantities, both of which vary.

    Parameters
    ----------
    first, other : ndarray, shape (n,)
        Paired values, at least two, neither all equal [any unit].

    Returns
    -------
    float
        From −1 to 1.

    Examples
    --------
    >>> pearson_r(np.array([20.0, 24.0, 30.0]), np.array([1.0, -1.0, -4.0]))
    -1.0
    """
    return float(np.clip(_standardized(first) @ _standardized(other), -1.0, 1.0))


def _standardized(values: FloatArray) -> FloatArray:
    """Centre, and scale to the length 1; first to the size 1, whose square is a number."""
    change = values - values.mean()
    change = change / np.abs(change).max()
    unit: FloatArray = change / np.linalg.norm(change)
    return unit


def fisher_interval(r: float, n: int) -> tuple[float, float] | None:
    """Compute the 95 % confidence interval of a correlation by Fisher's z.

    Returns
    -------
    tuple of two floats, or None where n < 4
        ±1 has no width: a straight line through all points.

    Examples
    --------
    >>> low, high = fisher_interval(0.5, 28)
    >>> round(low, 3), round(high, 3)
    (0.156, 0.736)
    """
    if n < ENOUGH:
        return None
    if abs(r) >= 1.0:
        return r, r
    half_width = float(ndtri((1.0 + CONFIDENCE) / 2.0)) / math.sqrt(n - 3)
    return math.tanh(math.atanh(r) - half_width), math.tanh(math.atanh(r) + half_width)


def williams_t(r_ya: float, r_yb: float, r_ab: float, n: int) -> float:
    """Compute Williams' T2 for the difference of two correlations with y in common.

    Parameters
    ----------
    r_ya, r_yb
        The correlations to compare: of y with a, and of y with b.
    n
        Number of observations of the three, at least 4.

    Returns
    -------
    float
        Distributed as Student's t with n − 3 degrees of freedom where r_ya and r_yb
        are equal in truth (Williams 1959; Steiger 1980, equation 7).

    Examples
    --------
    Steiger's example (p. 249) prints −0.8913:

    >>> round(williams_t(0.4, 0.5, 0.1, 103), 4)
    -0.8913
    """
    difference = r_ya - r_yb
    if abs(difference) <= ROUNDING:
        return 0.0
    determinant = 1 - r_ya**2 - r_yb**2 - r_ab**2 + 2 * r_ya * r_yb * r_ab
    # The determinant of three correlations is below 0 by rounding alone.
    scatter = 2 * (n - 1) / (n - 3) * max(determinant, 0.0)
    scatter += ((r_ya + r_yb) / 2) ** 2 * (1 - r_ab) ** 3
    if scatter <= 0.0:
        return math.copysign(math.inf, difference)
    return difference * math.sqrt((n - 1) * (1 + r_ab) / scatter)


def tell_apart(r_ya: float, r_yb: float, r_ab: float, n: int) -> bool:
    """Say whether two correlations with y in common differ at 5 %, two-sided.

    Parameters
    ----------
    r_ya, r_yb, r_ab, n
        As for `williams_t`; n < 4 tells nothing apart.

    Examples
    --------
    >>> tell_apart(0.9, 0.2, 0.1, 30), tell_apart(0.9, 0.2, 0.1, 4)
    (True, False)
    """
    if n < ENOUGH:
        return False
    critical = float(stdtrit(n - 3, (1.0 + CONFIDENCE) / 2.0))
    return abs(williams_t(r_ya, r_yb, r_ab, n)) >= critical
