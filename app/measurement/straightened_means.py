"""Means of both directions of runs, and the same without the line of their straightness."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from app.arrays import FloatArray
from app.measurement.reference_line import covariance_through, line_through, without_line
from app.measurement.run_means import RunMeans, mean_of_runs
from app.measurement.run_scatter import covariance_in_a_run


class BothWays(NamedTuple):
    """Means of the forward and, where it was run, the backward direction.

    `between` is the covariance of the forward means (rows) with the backward ones
    (columns); 0 where the directions were not run equally often, or once.
    """

    forward: RunMeans
    backward: RunMeans | None
    between: FloatArray

    @property
    def directions(self) -> list[RunMeans]:
        """Those that were run."""
        return [self.forward] if self.backward is None else [self.forward, self.backward]


def means_of_both_ways(
    positions_mm: FloatArray,
    forward: FloatArray,
    backward: FloatArray | None,
    repeatability: float | None,
) -> BothWays:
    """Average runs in both directions.

    Parameters
    ----------
    positions_mm : ndarray, shape (m,) [mm]
        Increasing.
    forward, backward : ndarray, shapes (n, m) and (k, m)
        Runs; where both directions were run equally often, readings of the same row are
        of the same run [any unit].
    repeatability
        As for `mean_of_runs`.

    Returns
    -------
    BothWays
    """
    runs, m = forward.shape
    between = np.zeros((m, m))
    there = mean_of_runs(positions_mm, forward, repeatability)
    if backward is None:
        return BothWays(there, None, between)
    if 1 < runs == len(backward):
        between = covariance_in_a_run(positions_mm, forward, backward) / runs
    return BothWays(there, mean_of_runs(positions_mm, backward, repeatability), between)


def straightened(positions_mm: FloatArray, both: BothWays, line: str) -> BothWays:
    """Take the line through the mean of both directions out of either.

    Parameters
    ----------
    positions_mm : ndarray, shape (m,) [mm]
        Increasing, at least two.
    both
        Means of both directions.
    line
        `least-squares` or `end-points`.

    Returns
    -------
    BothWays
        The reversal stays as it was; `between` is left as it came.

    Notes
    -----
    A shift or slope that a run has in both directions goes with the line, and is in the
    uncertainty of neither; one that differs between its directions stays in both.
    """
    forward, backward, between = both
    if backward is None:
        alone = without_line(positions_mm, line)
        return both._replace(forward=_combined(alone, [forward], forward.covariance))
    half = line_through(positions_mm, line) / 2
    operator = np.hstack([np.eye(positions_mm.size) - half, -half])
    return both._replace(
        forward=_combined(operator, [forward, backward], _joint(forward, backward, between)),
        backward=_combined(operator, [backward, forward], _joint(backward, forward, between.T)),
    )


def _joint(one: RunMeans, other: RunMeans, between: FloatArray) -> FloatArray | None:
    """Covariance of two directions' means together: (2m, 2m)."""
    if one.covariance is None or other.covariance is None:
        return None
    return np.block([[one.covariance, between], [between.T, other.covariance]])


def _combined(
    operator: FloatArray, directions: list[RunMeans], covariance: FloatArray | None
) -> RunMeans:
    """Combine the means of one direction, the first, with those of the other."""
    return replace(
        directions[0],
        mean=operator @ np.concatenate([one.mean for one in directions]),
        covariance=None if covariance is None else covariance_through(operator, covariance),
    )
