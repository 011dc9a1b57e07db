"""How the readings of repeated runs scatter: a shift and a slope of each run, and noise.

The axis warms up between runs, or its reference does: a run is shifted and stretched as a
whole, so that its readings agree with each other better than runs do, and runs differ
more at one end of the axis than at the other.

References
----------
N. M. Laird, J. H. Ware, *Random-effects models for longitudinal data*, Biometrics 38,
963–974 (1982): a random line of each subject, here of each run.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from scipy.special import chdtrc

from app.arrays import FloatArray
from app.units import MM_PER_M

POSITIONS_DIFFER: Final = 0.01
"""Probability by chance below which positions have standard deviations of their own."""

ROUNDING: Final = 1e-9
"""Share of the largest reading that rounding may leave."""


class RunScatter(NamedTuple):
    """Standard deviations of what a run's readings have in common, and of what is left.

    `shift` is that of a run at the mean position [unit of the readings], `slope_per_m`
    that of its slope [unit per m], NaN of fewer than three positions; `noise` is that of
    one reading beside its run's line, with `degrees_of_freedom`.
    """

    shift: float
    slope_per_m: float
    noise: float
    degrees_of_freedom: int


def scatter_of_runs(positions_mm: FloatArray, readings: FloatArray) -> RunScatter:
    """Part the scatter of runs into shift, slope and noise (analysis of variance).

    Parameters
    ----------
    positions_mm : ndarray, shape (m,) [mm]
        Increasing.
    readings : ndarray, shape (n, m)
        At least two runs over the positions [any unit].

    Returns
    -------
    RunScatter
        A shift or slope that the noise explains is 0.

    Examples
    --------
    >>> runs = np.array([[0.0, 1.0, 2.0], [0.0, 3.0, 6.0]])
    >>> found = scatter_of_runs(np.array([0.0, 500.0, 1000.0]), runs)
    >>> round(found.slope_per_m, 9), round(found.shift, 9), round(found.noise, 9)
    (2.828427125, 1.414213562, 0.0)
    """
    lines = _lines(positions_mm)
    of_lines, noise = _variances(lines, readings, readings)
    # Noise alone scatters each line's coefficient by σ², as the columns are orthonormal; less
    # than that is chance. Their norms, √m and √m · std, turn coefficients into shift and slope.
    beyond = np.sqrt(np.maximum(np.diagonal(of_lines) - noise, 0.0)).tolist()
    m = positions_mm.size
    shift = beyond[0] / math.sqrt(m) if beyond else 0.0
    slope = math.nan
    if len(beyond) > 1:
        slope = beyond[1] / (math.sqrt(m) * float(positions_mm.std())) * MM_PER_M
    freedom = (len(readings) - 1) * (m - lines.shape[1])
    return RunScatter(shift, slope, math.sqrt(max(noise, 0.0)), freedom)


def varies(readings: FloatArray) -> bool:
    """Say whether runs differ by more than rounding.

    Parameters
    ----------
    readings : ndarray, shape (n, m)
        Runs over positions [any unit].

    Returns
    -------
    bool
        False where they say nothing of their noise, as on a coarse scale.

    Examples
    --------
    >>> varies(np.array([[1.0, 2.0], [1.0, 2.0]])), varies(np.array([[1.0, 2.0], [1.0, 2.1]]))
    (False, True)
    """
    return bool(np.ptp(readings, axis=0).max() > ROUNDING * np.abs(readings).max())


def covariance_in_a_run(
    positions_mm: FloatArray, readings: FloatArray, others: FloatArray
) -> FloatArray:
    """Estimate how the readings of a run vary together with those of its other direction.

    Parameters
    ----------
    positions_mm : ndarray, shape (m,) [mm]
        Increasing.
    readings, others : ndarray, shape (n, m)
        Two directions of the same n ≥ 2 runs, or twice the same [any unit].

    Returns
    -------
    ndarray, shape (m, m) [unit squared]
        Rows of the first, columns of the second.

    Notes
    -----
    With the orthonormal columns Q of constant and slope, the covariance is
    Q S Qᵀ + σ² (I − Q Qᵀ): S that of the runs' lines as they scatter (n − 1 degrees of
    freedom), σ² the variance beside them ((n − 1)(m − 2)). It is unbiased, and not
    negative for both directions together. Two positions have no slope beside a shift.
    A position's noise is that of all, since the standard deviation of five readings is
    itself uncertain by 35 %; where Bartlett's test (1 %, at least three runs) finds that
    positions differ, each has its own variance s_i².
    """
    lines = _lines(positions_mm)
    covariance = _by_lines(lines, readings, others)
    sizes = _own_size(lines, readings), _own_size(lines, others)
    scaled: FloatArray = sizes[0][:, None] * covariance * sizes[1]
    return scaled


def _lines(positions_mm: FloatArray) -> FloatArray:
    """Orthonormal columns of shift and slope, as many as leave noise: (m, 0), (m, 1), (m, 2)."""
    m = positions_mm.size
    shift = np.full((m, 1), 1 / math.sqrt(m))
    if m < 3:
        return shift[:, : m - 1]
    centred = positions_mm - positions_mm.mean()
    return np.column_stack([shift, centred / np.linalg.norm(centred)])


def _variances(
    lines: FloatArray, readings: FloatArray, others: FloatArray
) -> tuple[FloatArray, float]:
    """Covariance of the runs' lines, and of one reading beside them."""
    n, m = readings.shape
    deviations, other = readings - readings.mean(axis=0), others - others.mean(axis=0)
    of_lines: FloatArray = (deviations @ lines).T @ (other @ lines) / (n - 1)
    # Orthonormal columns: what all readings vary less what their lines do is beside the lines.
    beside = float((deviations * other).sum()) / (n - 1) - float(np.trace(of_lines))
    return of_lines, beside / (m - lines.shape[1])


def _by_lines(lines: FloatArray, readings: FloatArray, others: FloatArray) -> FloatArray:
    of_lines, noise = _variances(lines, readings, others)
    beside = np.eye(len(lines)) - lines @ lines.T
    covariance: FloatArray = lines @ of_lines @ lines.T + noise * beside
    return covariance


def _own_size(lines: FloatArray, readings: FloatArray) -> FloatArray:
    """How many times a position's own standard deviation is that of all; 1 if none differs."""
    n, m = readings.shape
    common = np.sqrt(np.maximum(np.diagonal(_by_lines(lines, readings, readings)), 0.0))
    spread = readings.std(axis=0, ddof=1)
    # Equal readings of a coarse scale have no scatter that could be compared.
    rounding = ROUNDING * max(float(np.abs(readings).max()), float(spread.max()))
    if n < 3 or m < 2 or min(float(spread.min()), float(common.min())) <= rounding:
        return np.ones(m)
    differ = alike_by_chance(spread**2, n - 1) < POSITIONS_DIFFER
    sizes: FloatArray = spread / common if differ else np.ones(m)
    return sizes


def alike_by_chance(variances: FloatArray, freedom: int) -> float:
    """Probability that samples of equal variance differ so much, by Bartlett's test.

    Parameters
    ----------
    variances : ndarray, shape (m,)
        Of m ≥ 2 normal samples, each above zero.
    freedom
        Degrees of freedom of each: its size less one.

    References
    ----------
    M. S. Bartlett, *Properties of sufficiency and statistical tests*, Proc. R. Soc. A 160,
    268–282 (1937).
    """
    m = variances.size
    apart = m * freedom * (np.log(variances.mean()) - np.log(variances).mean())
    # Bartlett's 1 + (Σ 1/f − 1/Σ f) / (3 (m − 1)) of samples that all have the same f.
    return float(chdtrc(m - 1, apart / (1.0 + (m + 1) / (3.0 * m * freedom))))
