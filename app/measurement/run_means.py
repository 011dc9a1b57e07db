"""The mean of repeated runs over the positions of an axis, and what their scatter says of it.

References
----------
ISO 230-2:2014, clause 3: the estimator s_i of the standard deviation, and the repeatability
that follows from it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from app.arrays import FloatArray, frozen
from app.geometry.components import COMPONENTS
from app.measurement.reference_line import covariance_through, line_through, without_line
from app.measurement.run_scatter import RunScatter, covariance_in_a_run, scatter_of_runs, varies
from app.thermal.error_map import ComponentTable

COVER: Final = 2
"""ISO 230-2 widens by two standard deviations."""


@dataclass(frozen=True, slots=True, eq=False)
class RunMeans:
    """The mean of repeated runs at each position, and what their scatter says of it.

    Parameters
    ----------
    mean : ndarray, shape (m,)
        Mean over the runs [unit of the readings].
    standard_deviation : ndarray, shape (m,), or None
        ISO 230-2's estimator s_i; None of one run.
    covariance : ndarray, shape (m, m), or None
        Of the mean [unit squared].
    scatter
        Shift, slope and noise of the runs; None of one run.
    """

    mean: FloatArray
    standard_deviation: FloatArray | None
    covariance: FloatArray | None
    runs: int
    scatter: RunScatter | None

    @property
    def repeatability(self) -> FloatArray | None:
        """ISO 230-2's unidirectional repeatability at each position, R_i = 4 s_i."""
        deviation = self.standard_deviation
        return None if deviation is None else 2 * COVER * deviation


def mean_of_runs(
    positions_mm: FloatArray, readings: FloatArray, repeatability: float | None = None
) -> RunMeans:
    """Average runs, and tell the covariance of their mean from the scatter of the runs.

    Parameters
    ----------
    positions_mm : ndarray, shape (m,) [mm]
        Increasing.
    readings : ndarray, shape (n, m)
        n runs over the positions [any unit].
    repeatability
        Standard deviation of one reading, used for one run alone and for runs that do not
        differ [the same unit].

    Notes
    -----
    Runs that are equal, as on a coarse scale, leave the noise unknown: it is not 0.

    A reading is position's error + run's shift + run's slope · distance + noise; the
    covariance of the mean is that of `covariance_in_a_run` over n.

    Examples
    --------
    >>> mean_of_runs(np.array([0.0, 90.0]), np.array([[0.0, 4.0], [2.0, 6.0]])).mean.tolist()
    [1.0, 5.0]
    """
    n, m = readings.shape
    mean = frozen(readings.mean(axis=0))
    declared = None if repeatability is None else repeatability**2 * np.eye(m) / n
    if n < 2:
        return RunMeans(mean, None, declared, n, None)
    deviation = readings.std(axis=0, ddof=1)
    scatter = scatter_of_runs(positions_mm, readings)
    if not varies(readings):
        return RunMeans(mean, deviation, declared, n, scatter)
    covariance = covariance_in_a_run(positions_mm, readings, readings) / n
    return RunMeans(mean, deviation, covariance, n, scatter)


def table_of_means(
    code: str, positions_mm: FloatArray, forward: RunMeans, backward: RunMeans | None
) -> ComponentTable:
    """Make the component's table from the means of both directions.

    Parameters
    ----------
    positions_mm : ndarray, shape (m,) [mm]
        Strictly increasing.
    forward, backward
        The means [the component's unit].
    """
    return ComponentTable.make(
        COMPONENTS[code],
        forward.mean,
        positions_mm,
        backward_errors=None if backward is None else backward.mean,
        covariance=forward.covariance,
        backward_covariance=None if backward is None else backward.covariance,
    )


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
    # The line through the mean of both directions takes half from either: side by side, one
    # operator on both, so that what they have in common is propagated with them.
    half = line_through(positions_mm, line) / 2
    operator = np.hstack([np.eye(positions_mm.size) - half, -half])
    return both._replace(
        forward=_combined(operator, [forward, backward], _joint(forward, backward, between)),
        backward=_combined(operator, [backward, forward], _joint(backward, forward, between.T)),
    )


def _joint(first: RunMeans, other: RunMeans, between: FloatArray) -> FloatArray | None:
    """Covariance of two directions' means together: (2m, 2m)."""
    if first.covariance is None or other.covariance is None:
        return None
    return np.block([[first.covariance, between], [between.T, other.covariance]])


def _combined(
    operator: FloatArray, directions: list[RunMeans], covariance: FloatArray | None
) -> RunMeans:
    """Combine the means of one direction, the first, with those of the other."""
    return replace(
        directions[0],
        mean=operator @ np.concatenate([direction.mean for direction in directions]),
        covariance=None if covariance is None else covariance_through(operator, covariance),
    )
