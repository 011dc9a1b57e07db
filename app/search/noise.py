"""Repeatability of a channel: declared, from replicates, or from what the residuals leave.

N. Draper, H. Smith, Applied Regression Analysis (1998): pure error of replicates.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy.special import chdtr, chdtrc

from app.arrays import BoolArray, FloatArray, IntArray, rms, robust_sd
from app.search.priors import DECLARED_WEIGHT, ESTIMATED_WEIGHT, POOLED_WEIGHT
from app.search.rows import DeclaredNoise, Rows

ENOUGH_REPLICATES: Final = 5
"""Degrees of freedom below which replicates say too little about the scatter."""

DENIED: Final = 1.5
"""Times the declared repeatability from which replicates deny it: less is a matter of rounding."""

DENIED_BY_CHANCE: Final = 1e-3
"""Probability that replicates which are as declared seem to deny it: there are many channels."""

COMMON: Final = "common"
"""Origin of a repeatability that nearly all channels show together (`common_scatter`)."""

KNOWN: Final = frozenset({"declared", COMMON, "rounding"})
"""Origins of a repeatability that does not rest on the few values of a channel."""

MOST_POOLED: Final = 20
"""So many degrees of freedom the replicates of channels that are alike count for at most."""

NOTHING_LEFT: Final = 1e-9
"""Share of their size from which residuals beside a shift and a tilt are more than rounding."""


class Repeatability(NamedTuple):
    """Scatter of one observation, where it comes from, and what it counts for."""

    value: float
    origin: str
    weight: float


def repeatability(rows: Rows, channel: int, use: BoolArray) -> Repeatability:
    """Find the repeatability of one channel.

    Parameters
    ----------
    use : ndarray, shape (n,)
        Which rows take part.

    Returns
    -------
    Repeatability
        Origin is `declared`, `common`, `replicates`, `residuals` or `rounding`. What is declared
        (or shown by nearly all channels in its place) counts unless replicates surely scatter by
        more: then it is not that of these measurements.
        Without it, values read in coarse steps repeat each other exactly where little moves, and
        scatter by their rounding all the same.
    """
    noise = rows.noise.get(channel, DeclaredNoise())
    declared = noise.repeatability
    variance, freedom = pure_error(rows, channel, use)
    if declared is not None and not is_denied(declared, variance, freedom):
        return Repeatability(declared, noise.origin, DECLARED_WEIGHT)
    if freedom >= ENOUGH_REPLICATES and variance > 0:
        pooled_scatter = _pooled_with_alike(rows, channel, use, variance, freedom)
        return at_least_rounding(rows, channel, pooled_scatter)
    pooled_scatter = Repeatability(
        _within_visits(rows, channel, use), "residuals", ESTIMATED_WEIGHT
    )
    return at_least_rounding(rows, channel, pooled_scatter)


def at_least_rounding(rows: Rows, channel: int, estimate: Repeatability) -> Repeatability:
    """Let a channel scatter by no less than the steps in which it is read."""
    least = rows.noise.get(channel, DeclaredNoise()).rounding
    return (
        estimate if estimate.value >= least else Repeatability(least, "rounding", DECLARED_WEIGHT)
    )


def is_denied(declared: float, variance: float, freedom: int, side: int = 1) -> bool:
    """Whether a variance is more (side 1) or less (−1) than is declared, by a margin and surely."""
    if freedom < ENOUGH_REPLICATES or variance**side <= (DENIED**side * declared) ** (2 * side):
        return False
    chance = chdtrc if side > 0 else chdtr
    return float(chance(freedom, variance * freedom / declared**2)) < DENIED_BY_CHANCE


def _pooled_with_alike(
    rows: Rows, channel: int, use: BoolArray, variance: float, freedom: int
) -> Repeatability:
    """Let few replicates lean on those of the channels that are alike."""
    name = rows.alike.get(channel)
    others = [c for c, n in rows.alike.items() if n == name and c != channel] if name else []
    pooled = [pure_error(rows, c, use) for c in others]
    count = sum(f for _, f in pooled)
    if not count:
        return Repeatability(float(np.sqrt(variance)), "replicates", ESTIMATED_WEIGHT)
    common = sum(v * f for v, f in pooled) / count
    leant = min(MOST_POOLED, count)
    value = (variance * freedom + common * leant) / (freedom + leant)
    return Repeatability(float(np.sqrt(value)), "replicates", POOLED_WEIGHT)


def shows_scatter(rows: Rows, channel: int, use: BoolArray) -> bool:
    """Whether a shift and a tilt of each visit leave anything over of what scatters in it.

    Parameters
    ----------
    use : ndarray, shape (n,)
        Which rows take part.
    """
    mine = use & (rows.channel == channel)
    for visit in np.unique(rows.visit[mine]):
        of_visit = mine & (rows.visit == visit)
        shapes = np.column_stack([np.ones(int(of_visit.sum())), rows.tilt[of_visit]])
        coefficients, _, rank, _ = np.linalg.lstsq(shapes, rows.values[of_visit], rcond=None)
        residuals = rows.values[of_visit] - shapes @ coefficients
        if rank < len(residuals) and rms(residuals) > NOTHING_LEFT * rms(rows.values[of_visit]):
            return True
    return False


def replicate_scatter(rows: Rows, channel: int, use: BoolArray) -> float | None:
    """Give what replicates alone show of the scatter of one observation; None where too few do.

    As few degrees of freedom as are enough leave it uncertain by a third, so those of channels
    that are alike are pooled with them.

    Parameters
    ----------
    use : ndarray, shape (n,)
        Which rows take part.
    """
    variance, freedom = pure_error(rows, channel, use)
    if freedom < ENOUGH_REPLICATES or variance <= 0:
        return None
    return _pooled_with_alike(rows, channel, use, variance, freedom).value


def pure_error(rows: Rows, channel: int, use: BoolArray) -> tuple[float, int]:
    """Pool the variance of replicates about their means.

    Parameters
    ----------
    use : ndarray, shape (n,)
        Which rows take part.

    Returns
    -------
    variance : float
        In the channel's unit, squared; 0 without replicates.
    freedom : int
        Its degrees of freedom.
    """
    mine = use & (rows.channel == channel) & (rows.replicate >= 0)
    if not mine.any():
        return 0.0, 0
    # One number for each pair: pairs themselves are sorted many times slower.
    pair = rows.visit[mine] * (1 + int(rows.replicate.max())) + rows.replicate[mine]
    _, group = np.unique(pair, return_inverse=True)
    residuals = deviations(rows.values[mine], group)
    freedom = int(mine.sum() - (group.max() + 1))
    return (float(np.sum(residuals**2)) / freedom if freedom else 0.0), freedom


def deviations(values: FloatArray, group: IntArray) -> FloatArray:
    """Take the mean of its group off each value.

    Parameters
    ----------
    values : ndarray, shape (n,)
    group : ndarray, shape (n,)
        Numbers of the groups, from 0.

    Returns
    -------
    ndarray, shape (n,)

    Examples
    --------
    >>> deviations(np.array([1.0, 3.0, 5.0]), np.array([0, 0, 1]))
    array([-1.,  1.,  0.])
    """
    counts = np.maximum(np.bincount(group), 1)
    return np.asarray(values - (np.bincount(group, weights=values) / counts)[group])


def _within_visits(rows: Rows, channel: int, use: BoolArray) -> float:
    """Take a first guess, robustly; the fit of the maps refines it."""
    mine = use & (rows.channel == channel)
    _, group = np.unique(rows.visit[mine], return_inverse=True)
    residuals = deviations(rows.values[mine], group.ravel())
    guess = robust_sd(residuals)
    return guess or rms(residuals) or rms(rows.values[mine]) or 1.0
