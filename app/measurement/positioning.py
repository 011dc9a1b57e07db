"""Positioning of a linear axis by ISO 230-2:2014, and the linear displacement error it shows.

Deviations x_ij = measured minus target position, at targets i in runs j, approached in the
positive (forward, ↑) and the negative direction (backward, ↓).

References
----------
ISO 230-2:2014, *Test code for machine tools — Determination of accuracy and repeatability
of positioning of numerically controlled axes*, clause 3 (definitions) and 7 (evaluation).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray
from app.errors import InvalidContent
from app.measurement.positioning_figures import bidirectional_repeatability, figures_of
from app.measurement.positioning_notes import notes_on
from app.measurement.result import MeasurementResult
from app.measurement.run_means import RunMeans, mean_of_runs, table_of_means
from app.measurement.stated_axes import expect_linear_axis
from app.measurement.stated_numbers import as_standard_deviation
from app.measurement.stated_runs import as_positions, as_runs


@dataclass(frozen=True, slots=True, eq=False)
class Positioning:
    """ISO 230-2's evaluation of one axis.

    Parameters
    ----------
    axis
        `x`, `y` or `z`.
    targets_mm : ndarray, shape (m,) [mm]
        Target positions.
    forward, backward
        Means x̄↑ and x̄↓, standard deviations s↑ and s↓, repeatabilities R↑ and R↓ at
        each target [µm]; backward is None where nobody approached so.
    mean_um : ndarray, shape (m,) [µm]
        Mean of both directions, x̄_i; of the forward one alone without the other.
    reversal_um : ndarray, shape (m,), or None [µm]
        Reversal error B_i = x̄↑ − x̄↓, with its sign.
    bidirectional_repeatability_um : ndarray, shape (m,), or None [µm]
        R_i.
    result
        E{axis}{axis} in both directions, and the figures of the axis.
    """

    axis: str
    targets_mm: FloatArray
    forward: RunMeans
    backward: RunMeans | None
    mean_um: FloatArray
    reversal_um: FloatArray | None
    bidirectional_repeatability_um: FloatArray | None
    result: MeasurementResult


def evaluate_positioning(
    axis: str,
    targets_mm: ArrayLike,
    forward_um: ArrayLike,
    backward_um: ArrayLike = (),
    *,
    repeatability_um: float | None = None,
) -> Positioning:
    """Evaluate runs over target positions as ISO 230-2:2014 does.

    Parameters
    ----------
    axis
        `x`, `y` or `z`.
    targets_mm : array-like, shape (m,) [mm]
        Target positions, strictly increasing.
    forward_um, backward_um : array-like, shape (n, m), or (m,) for one run [µm]
        Measured minus target position, approached in the positive and the negative
        direction; backward may be empty (a unidirectional test).
    repeatability_um
        Standard deviation of one reading [µm], for a direction that was run once or whose runs
        do not differ.

    Returns
    -------
    Positioning
        R and A need two runs of each direction; E, M and B one.

    Raises
    ------
    InvalidContent
        If there is no such axis, if targets do not increase, if numbers are missing, not
        finite or so large that they cannot be deviations in µm.

    Notes
    -----
    B is max |B_i|; B_i keeps its sign. E, R and A are the standard's bi-directional
    figures: over both directions together, not the larger of the two.

    Examples
    --------
    >>> found = evaluate_positioning(
    ...     "x", [0.0, 100.0], [[0.0, 2.0], [1.0, 3.0]], [[-2.0, 1.0], [-1.0, 2.0]]
    ... )
    >>> found.reversal_um.tolist(), found.result.figures["E_um"]
    ([2.0, 1.0], 4.0)
    """
    expect_linear_axis(axis)
    targets = as_positions("targets_mm", targets_mm)
    runs = _runs_of_both_ways(forward_um, backward_um, targets)
    spread = as_standard_deviation("repeatability_um", repeatability_um, "µm")
    ways = {way: mean_of_runs(targets, readings, spread) for way, readings in runs.items()}
    forward, backward = ways["forward"], ways.get("backward")
    code = f"E{axis}{axis}".upper()
    return Positioning(
        axis=axis,
        targets_mm=targets,
        forward=forward,
        backward=backward,
        mean_um=np.mean([way.mean for way in ways.values()], axis=0),
        reversal_um=None if backward is None else forward.mean - backward.mean,
        bidirectional_repeatability_um=bidirectional_repeatability(forward, backward),
        result=MeasurementResult(
            tables=(table_of_means(code, targets, forward, backward),),
            figures=figures_of(ways, runs),
            notes=notes_on(targets, runs),
        ),
    )


def _runs_of_both_ways(
    forward_um: ArrayLike, backward_um: ArrayLike, targets_mm: FloatArray
) -> dict[str, FloatArray]:
    """Take the readings; a direction without any is absent."""
    runs = {"forward": as_runs("forward_um", forward_um, targets_mm.size, "µm")}
    if not _is_empty(backward_um):
        runs["backward"] = as_runs("backward_um", backward_um, targets_mm.size, "µm")
    for way, readings in runs.items():
        # No scale is wrong by exactly 1 mm/m: within half a micrometre over 50 mm.
        if (
            targets_mm.size > 2
            and np.ptp(targets_mm) >= 50
            and np.abs(readings - targets_mm).max() < 0.5
        ):
            raise InvalidContent.of_field(
                f"{way}_um",
                "expected deviations from the targets in µm (measured minus target), came the "
                "targets themselves: these look like measured positions in mm",
            )
    return runs


def _is_empty(stated: ArrayLike) -> bool:
    return isinstance(stated, list | tuple | np.ndarray) and len(stated) == 0
