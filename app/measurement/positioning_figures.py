"""ISO 230-2's figures of an axis, and what its runs say of themselves.

References
----------
ISO 230-2:2014, clause 3.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np
from scipy.stats import linregress

from app.arrays import FloatArray
from app.measurement.run_means import COVER, RunMeans


def figures_of(ways: Mapping[str, RunMeans], runs: Mapping[str, FloatArray]) -> dict[str, float]:
    """Sum up the axis as the standard does.

    Parameters
    ----------
    ways
        `forward`, and `backward` where it was run, to the means.
    runs
        The same to the readings [µm].

    Returns
    -------
    dict
        B, M, E, R and A of both directions, E, R and A of each, noise, shift and slope from
        run to run, and drift; the unit is in each name.
    """
    figures: dict[str, float] = {}
    for name, way in ways.items():
        figures |= _figures_of([way], f"_{name}")
    forward, backward = ways["forward"], ways.get("backward")
    if backward is not None:
        reversal = forward.mean - backward.mean
        figures["B_um"] = float(np.abs(reversal).max())
        figures["B_mean_um"] = float(reversal.mean())
        figures["M_um"] = float(np.ptp((forward.mean + backward.mean) / 2))
        figures |= _figures_of([forward, backward], "")
        at_each = bidirectional_repeatability(forward, backward)
        if at_each is not None:
            figures["R_um"] = float(at_each.max())
    return figures | _scatter(ways, runs)


def bidirectional_repeatability(forward: RunMeans, backward: RunMeans | None) -> FloatArray | None:
    """Compute R_i = max(2 s↑ + 2 s↓ + |B_i|; R↑; R↓).

    Parameters
    ----------
    forward, backward
        Means and standard deviations of both directions [µm].

    Returns
    -------
    ndarray, shape (m,), or None [µm]
        None where a direction was not run, or only once.
    """
    if backward is None:
        return None
    up, down = forward.standard_deviation, backward.standard_deviation
    if up is None or down is None:
        return None
    together: FloatArray = COVER * (up + down) + np.abs(forward.mean - backward.mean)
    each: FloatArray = 2 * COVER * np.maximum(up, down)
    return np.maximum(together, each)


def drift_of(runs: Mapping[str, FloatArray]) -> tuple[float, float] | None:
    """Fit a line to the runs' means.

    Parameters
    ----------
    runs
        Direction to readings, one row for each run [µm].

    Returns
    -------
    drift, by_chance : float, or None
        Change from the first run to the last [µm], and its probability by chance; None
        where the directions were not run equally often.
    """
    if len({len(readings) for readings in runs.values()}) > 1:
        return None
    means = np.mean([readings.mean(axis=1) for readings in runs.values()], axis=0)
    if means.size < 3 or np.ptp(means) == 0:
        return float(means[-1] - means[0]), 1.0
    line = linregress(np.arange(means.size), means)
    return float(line.slope) * (means.size - 1), float(line.pvalue)


def _figures_of(ways: list[RunMeans], suffix: str) -> dict[str, float]:
    """E and A over one direction or both; R of one direction."""
    means = np.array([way.mean for way in ways])
    figures = {f"E{suffix}_um": float(np.ptp(means))}
    spreads = [way.standard_deviation for way in ways if way.standard_deviation is not None]
    if len(spreads) == len(ways):
        band = COVER * np.array(spreads)
        figures[f"A{suffix}_um"] = float((means + band).max() - (means - band).min())
        if len(ways) == 1:
            figures[f"R{suffix}_um"] = float(2 * COVER * spreads[0].max())
    return figures


def _scatter(ways: Mapping[str, RunMeans], runs: Mapping[str, FloatArray]) -> dict[str, float]:
    """What the runs say of themselves: noise, shift and slope from run to run, drift."""
    scatters = [way.scatter for way in ways.values() if way.scatter is not None]
    if not scatters:
        return {}
    figures = {
        "noise_um": _root_mean_square(one.noise for one in scatters),
        "run_shift_um": _root_mean_square(one.shift for one in scatters),
        "noise_degrees_of_freedom": float(sum(one.degrees_of_freedom for one in scatters)),
    }
    slope = _root_mean_square(one.slope_per_m for one in scatters)
    if math.isfinite(slope):
        figures["run_slope_um_per_m"] = slope
    drift = drift_of(runs)
    if drift is not None:
        figures["drift_um"] = drift[0]
    if len(scatters) == 2 and ways["forward"].runs == ways["backward"].runs:
        of_runs = (runs["forward"] - runs["backward"]).mean(axis=1)
        standard_error = float(of_runs.std(ddof=1)) / math.sqrt(of_runs.size)
        figures["B_mean_standard_error_um"] = standard_error
    return figures


def _root_mean_square(values: Iterable[float]) -> float:
    return math.sqrt(float(np.mean(np.square(list(values)))))
