"""Values, closures and holes that lie far from the rest: named as suspicious, and kept.

References
----------
B. Iglewicz, D. C. Hoaglin, *How to detect and handle outliers* (1993): the median of
absolute deviations as a scale. P. J. Rousseeuw, A. M. Leroy, *Robust regression and outlier
detection* (1987).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from app.arrays import FloatArray, robust_sd

FAR_VALUE: Final = 5.0
FAR_HOLE: Final = 6.0
"""Robust standard deviations from the rest, beyond which a value or a hole is suspicious."""

FEWEST_TO_JUDGE: Final = 6
FEWEST_STEPS_TO_JUDGE: Final = 4
"""Of fewer none can be told from the rest."""

# √(π/2).
NORMAL_PER_MEAN: Final = 1.2533
"""Standard deviation over mean of absolute deviations, of a normal distribution: it serves where
more than half of the values are equal."""

ROUNDING: Final = 1e-9
"""Share of the largest value that rounding may leave."""

ROUNDING_UM: Final = 1e-6


def far_from_the_rest(positions_mm: FloatArray, values: FloatArray) -> tuple[int, ...]:
    """Find values that lie far from the line through the others.

    Parameters
    ----------
    positions_mm : ndarray, shape (m,) [mm]
    values : ndarray, shape (m,) [any unit]

    Returns
    -------
    tuple of int
        Indices of values further than 5 robust standard deviations from the line of
        repeated medians (Siegel), which half of the values cannot bend; none of fewer
        than six values.

    Notes
    -----
    The scale is 1.4826 times the median of the absolute deviations, or 1.2533 times their
    mean where that median is zero (Iglewicz and Hoaglin; a misread value then shows among
    eleven or more), times 1 + 5/(m − 2) because few values scatter less about a line
    through themselves (Rousseeuw and Leroy 1987, for a robust line). Of series without a
    wrong value 5 % of those of six normal values have a suspicious one, 1 % of those of 17.

    Examples
    --------
    >>> far_from_the_rest(np.arange(8.0), np.array([0, 0.1, 9, 0, 0.1, 0, 0.2, 0.1]))
    (2,)
    """
    if values.size < FEWEST_TO_JUDGE:
        return ()
    from scipy.stats import siegelslopes  # takes half a second to import

    fitted = siegelslopes(values, positions_mm)
    deviations = values - fitted.intercept - fitted.slope * positions_mm
    sizes = np.abs(deviations - np.median(deviations))
    return _far(sizes, 2, ROUNDING * float(np.abs(values).max()))


def far_closures(closures_um: FloatArray) -> tuple[int, ...]:
    """Find closures that lie far from those of the same axis.

    Parameters
    ----------
    closures_um : ndarray, shape (3, n) [µm]
        Axis by interval.

    Returns
    -------
    tuple of int
        Indices into the flattened closures, the farthest first, of those further than 5
        robust standard deviations from the median of their axis, on the scale of
        `far_from_the_rest`; none of fewer than four on each axis.

    Examples
    --------
    >>> far_closures(np.array([[0, 0.1, 9, 0.1], [0, 0.1, 0, 0.2], [0.1, 0.2, 0, 0]]))
    (2,)
    """
    if closures_um.shape[1] < FEWEST_STEPS_TO_JUDGE:
        return ()
    middle = np.median(closures_um, axis=1, keepdims=True)
    sizes: FloatArray = np.abs(closures_um - middle).ravel()
    return tuple(sorted(_far(sizes, 3, ROUNDING_UM), key=lambda i: -float(sizes[i])))


def far_holes(residuals_um: FloatArray) -> tuple[int, ...]:
    """Find holes whose residuals lie far from those of the others.

    Parameters
    ----------
    residuals_um : ndarray, shape (n, 2) [µm]
        What is left of each hole's x and y.

    Returns
    -------
    tuple of int
        Indices of holes further than 6 robust standard deviations of one coordinate from
        the median hole; none of fewer than six holes.

    Examples
    --------
    >>> far_holes(np.array([[0, 0], [1, 0], [0, 1], [9, -9], [1, 1], [0, -1], [-1, 0.0]]))
    (3,)
    """
    if len(residuals_um) < FEWEST_TO_JUDGE:
        return ()
    deviations = residuals_um - np.median(residuals_um, axis=0)
    return _beyond(np.hypot(*deviations.T), max(FAR_HOLE * robust_sd(deviations), ROUNDING_UM))


def _far(sizes: FloatArray, unknowns: int, rounding: float) -> tuple[int, ...]:
    """Find sizes beyond 5 robust standard deviations, of which few scatter less."""
    scale = robust_sd(sizes)
    if scale <= rounding:
        scale = NORMAL_PER_MEAN * float(sizes.mean())
    few = 1 + 5 / (sizes.size - unknowns)
    return _beyond(sizes, max(FAR_VALUE * few * scale, rounding))


def _beyond(sizes: FloatArray, limit: float) -> tuple[int, ...]:
    return tuple(int(i) for i in np.flatnonzero(sizes > limit))
