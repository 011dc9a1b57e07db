"""What four step diagonals say about their own noise and about their mirror's tilt.

Three unknown increments meet four readings, so every step of every axis leaves one
closure residual. A mirror that is tilted by small angles adds to each diagonal a constant
for each axis' step, which sums to zero over the three; of these eight numbers the
closures show three as their means, three turn the axes as a whole, and two are not to be
told from differences between the axes' scales. The first three, once seen, are taken out
of the squareness.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.sparse import csr_array
from scipy.special import chdtri, fdtri

from app.arrays import FloatArray
from app.measurement.step_diagonal_input import StepWalk
from app.units import MM_PER_M

CERTAIN: Final = 0.99
"""How sure it must be that the closures' means are more than noise to call them a tilt."""

ROUNDING_UM: Final = 1e-6
"""Closures that vary by no more say nothing of the noise: a coarse scale, or a simulation."""


@dataclass(frozen=True, slots=True)
class StepNoise:
    """What the uncertainty of all components follows from.

    Parameters
    ----------
    reading_um
        Standard deviation of one reading, the zero included [µm]; None where unknown.
    degrees_of_freedom
        Behind it; infinite where it was stated, 0 where unknown.
    tilt_urad
        Standard uncertainty of each of a mirror's two tilts that is counted [µrad].
    seen_tilt_urad
        Tilt that the closures' means show [µrad]; None where there are no closures or
        they show none.
    hidden_tilt_urad
        Tilt that they would not show [µrad]; None where there are no closures or the noise
        is unknown.
    """

    reading_um: float | None
    degrees_of_freedom: float
    tilt_urad: float
    seen_tilt_urad: float | None = None
    hidden_tilt_urad: float | None = None


def solution_of(walk: StepWalk) -> FloatArray:
    """Solve the increments that three or four diagonals saw for their three directions.

    Returns
    -------
    ndarray, shape (3, m)
        Times increments of m diagonals: the error's change in x, y and z, by least
        squares. Each direction's row has the squares' sum R²/(4 V²) with four diagonals
        (step V in that direction, R² = X² + Y² + Z²) and R²/(2 V²) with three.
    """
    # With four diagonals the columns of r are orthogonal, and 2V/R long: each direction has the
    # mean of four readings, with half the variance of [V 7–8], which take two diagonals at a time.
    solution: FloatArray = np.asarray(np.linalg.pinv(walk.rays), dtype=np.float64)
    return solution


def closure_um(walk: StepWalk, increments_um: FloatArray) -> FloatArray:
    """Compute what is left of each four increments when three unknowns are solved for.

    Parameters
    ----------
    increments_um : ndarray, shape (4, 3, n) [µm]
        As `StepWalk.by_interval` gives them.

    Returns
    -------
    ndarray, shape (3, n) [µm]
        Axis by interval; as large as the noise of one increment, √2 that of a reading.
    """
    closure: FloatArray = np.einsum("d,dui->ui", _across(walk), increments_um)
    return closure


def step_noise(
    walk: StepWalk,
    closure: FloatArray | None,
    repeatability_um: float | None,
    mirror_angle_urad: float | None,
) -> StepNoise:
    """Estimate the noise from the closures, or take what was stated.

    Parameters
    ----------
    closure : ndarray, shape (3, n), optional [µm]
        Closures; None where there are three diagonals.
    repeatability_um
        Stated standard deviation of one reading [µm]; counts where closures leave no
        degree of freedom, or do not vary.
    mirror_angle_urad
        Stated standard uncertainty of each of a mirror's two tilts [µrad]; where None,
        what the closures' means show beyond noise.

    Notes
    -----
    The axes' means are removed first, for they hold the mirror, unless the mirror is
    stated to be aligned (0). Closures of neighbouring axes share readings: the degrees of
    freedom are those of a χ² with the same two moments (Welch, Satterthwaite).
    """
    declared = StepNoise(
        repeatability_um, 0.0 if repeatability_um is None else np.inf, mirror_angle_urad or 0.0
    )
    if closure is None or (walk.steps == 1 and mirror_angle_urad != 0.0):
        return declared
    tilted = mirror_angle_urad != 0.0
    share, freedom = _moments(walk, tilted)
    rest = closure - closure.mean(axis=1, keepdims=True) if tilted else closure
    shown_um = float(np.sqrt((rest**2).sum() / share))
    reading_um: float | None = shown_um
    if shown_um <= ROUNDING_UM:
        reading_um, freedom = declared.reading_um, declared.degrees_of_freedom
    if not tilted:
        return StepNoise(reading_um, freedom, 0.0)
    seen, hidden = _tilt(walk, closure.mean(axis=1), reading_um, freedom)
    counted = mirror_angle_urad if mirror_angle_urad is not None else (seen or 0.0)
    return StepNoise(reading_um, freedom, counted, seen, hidden)


def table_covariance(
    walk: StepWalk, solution: FloatArray, noise: StepNoise, axis: int, direction: int
) -> FloatArray | None:
    """Propagate the readings' noise to one translation's errors along its axis.

    Parameters
    ----------
    solution : ndarray, shape (3, m)
        Turns m diagonals' increments into an increment's three directions.
    axis, direction
        Which translation: 0, 1, 2 for x, y, z.

    Returns
    -------
    ndarray, shape (n + 1, n + 1), or None where the noise is unknown [µm²]
        Errors are sums of increments, so that they vary together: min(i, j) increments
        in common, which share no reading with each other; a tilt adds a straight line.
    """
    if noise.reading_um is None:
        return None
    nodes = np.arange(walk.steps + 1.0)
    weights = solution[direction] ** 2
    # Each increment is the difference of two readings.
    random = 2 * noise.reading_um**2 * weights.sum() * np.minimum.outer(nodes, nodes)
    # Only the part of the step across the ray is a lever for the mirror's tilt; it adds the same
    # to each increment, so that nodes vary together as a straight line.
    lateral_m2 = (walk.step_mm[axis] / MM_PER_M) ** 2 * (1 - walk.rays[:, axis] ** 2)
    tilted = noise.tilt_urad**2 * float(weights @ lateral_m2) * np.outer(nodes, nodes)
    covariance: FloatArray = random + tilted
    return covariance


def variance_of(walk: StepWalk, noise: StepNoise, weights: FloatArray) -> float | None:
    """Propagate the readings' noise to a weighted sum of increments.

    Parameters
    ----------
    weights : ndarray, shape (m, 3, n)
        Of the increments.

    Returns
    -------
    float or None where the noise is unknown
        Square of [µm times the weights' unit].
    """
    if noise.reading_um is None:
        return None
    by_reading = walk.reading_weights(weights)
    # A tilt has no part along the ray: only the lever across it counts.
    lever_m = weights.sum(axis=2) * walk.step_mm / MM_PER_M
    across = lever_m - (lever_m * walk.rays).sum(axis=1, keepdims=True) * walk.rays
    variance = noise.reading_um**2 * (by_reading**2).sum() + noise.tilt_urad**2 * (across**2).sum()
    return float(variance)


def mirror_in_squareness(walk: StepWalk, axis: int) -> FloatArray:
    """Weigh one axis' increments so that they give the tilts' share of a squareness.

    Parameters
    ----------
    axis
        0, 1, 2 for x, y, z: the squareness is that of the other two axes, U and V.

    Returns
    -------
    ndarray, shape (m,)
        Times the mean increment per metre of that axis: R/(2 UV) of its closure over its
        step; 0 where three diagonals leave no closure.

    Notes
    -----
    A tilt t of a diagonal's mirror, t · r = 0, adds s·t_u to each increment of axis u. The
    slopes of E_u(v) and E_v(u) gain R/(4UV) Σ σ_u σ_v (σ_u U t_u + σ_v V t_v), in which the
    bracket is −σ_w W t_w.
    """
    if len(walk.diagonals) < 4:
        return np.zeros(len(walk.diagonals))
    step_m = walk.step_mm / MM_PER_M
    share = np.linalg.norm(step_m) * step_m[axis] ** 2 / (2 * step_m.prod())
    weights: FloatArray = share * _across(walk)
    return weights


def neighbours_correlation(closure: FloatArray) -> float | None:
    """Correlate each closure with the next one of its axis.

    Parameters
    ----------
    closure : ndarray, shape (3, n) [µm]

    Returns
    -------
    float or None where there are fewer than four on an axis
        About 0 where each reading has its own noise, about −½ where each position of an
        axis has: then errors far from the start are better known than the covariance says.
    """
    rest = closure - closure.mean(axis=1, keepdims=True)
    if closure.shape[1] < 4 or not rest.any():
        return None
    n = float(closure.shape[1])
    products = float((rest[:, 1:] * rest[:, :-1]).sum())
    return products / float((rest**2).sum()) * n / (n - 1)


def _across(walk: StepWalk) -> FloatArray:
    """Unit vector across all three columns that the unknowns span: (−1, 1, 1, 1)/2."""
    across: FloatArray = -walk.ways.prod(axis=1) / 2
    return across


def _moments(walk: StepWalk, tilted: bool) -> tuple[float, float]:
    """Trace of the closures' covariance for readings of variance 1, and its χ²'s freedom."""
    n, m = walk.steps, len(walk.diagonals)
    diagonal, step, axis = np.indices((m, n, 3)).reshape(3, -1)
    # An increment is the reading after a step less the one before; downwards, the first step
    # crosses the highest interval, and the increment enters with its sign reversed.
    up = walk.ways[diagonal, axis]
    closure = axis * n + np.where(up > 0, step, n - 1 - step)
    after = diagonal * (3 * n + 1) + 3 * step + axis + 1
    weight = _across(walk)[diagonal] * up
    by_reading = csr_array(
        (
            np.concatenate([weight, -weight]),
            (np.concatenate([closure, closure]), np.concatenate([after, after - 1])),
        ),
        shape=(3 * n, m * (3 * n + 1)),
    )
    covariance = by_reading @ by_reading.T
    first = float(covariance.trace())
    second = float((covariance**2).sum())  # of a sparse array `**` is by element: tr(C²)
    # With the axes' means M taken out, P = I − M Mᵀ: tr(PC) and tr(PCPC), without making PCP,
    # which would not be sparse.
    if tilted:
        means = np.kron(np.eye(3), np.full((n, 1), n**-0.5))
        spread = covariance @ means
        first -= float((means * spread).sum())
        second += float(((means.T @ spread) ** 2).sum() - 2 * (spread**2).sum())
    return first, first**2 / second


def _tilt(
    walk: StepWalk, means_um: FloatArray, reading_um: float | None, freedom: float
) -> tuple[float | None, float | None]:
    """Ask of the closures' means which tilt they show, and which one they would hide."""
    # Rays of the four diagonals differ in signs alone: one stands for all. The n closures of an
    # axis share no reading, and each has the variance of a difference of two.
    lever2_m2 = (walk.step_mm / MM_PER_M) ** 2 * (1 - walk.rays[0] ** 2)
    variance_um2 = 2 * (reading_um or ROUNDING_UM) ** 2 / walk.steps
    # Three means against noise that was estimated are as F, against stated noise as χ²/3.
    has_freedom = 0 < freedom < np.inf
    limit = float(fdtri(3.0, freedom, CERTAIN) if has_freedom else chdtri(3.0, 1 - CERTAIN) / 3.0)
    seen_urad = None
    if (means_um**2).mean() > limit * variance_um2:
        share = float(((means_um**2 - variance_um2) / lever2_m2).mean())
        seen_urad = float(np.sqrt(max(share, 0.0)))
    if reading_um is None:
        return seen_urad, None
    return seen_urad, float(np.sqrt(limit * variance_um2 / lever2_m2.mean()))
