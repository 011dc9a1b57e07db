"""Positioning of a linear axis by ISO 230-2:2014, and the linear displacement error it shows.

Deviations x_ij = measured minus target position, at targets i in runs j, approached in the
positive (forward, ↑) and the negative direction (backward, ↓).

References
----------
ISO 230-2:2014, *Test code for machine tools — Determination of accuracy and repeatability
of positioning of numerically controlled axes*, clause 3 (definitions) and 7 (evaluation).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from app.answer import AS_IT_IS, Answer, shown
from app.arrays import FloatArray, rms
from app.measurement.result import Evaluated, MeasurementResult
from app.measurement.run_means import COVER, RunMeans, mean_of_runs, table_of_means
from app.measurement.run_scatter import varies
from app.measurement.stated_numbers import as_standard_deviation, suspiciously_small
from app.measurement.stated_runs import as_positions, as_runs, expect_linear_axis
from app.rounding import Digits, Micro
from app.units import MM_PER_M

RUNS_OF_THE_STANDARD: Final = 5
TARGETS_OF_THE_STANDARD: Final = 5
"""In each direction; targets per metre, and at least so many."""

SIGNIFICANT: Final = 0.01
"""Probability by chance below which runs are said to drift."""


@dataclass(frozen=True, slots=True)
class TargetAnswer(Answer):
    """ISO 230-2's values at one target position."""

    target_mm: float
    """Target position [mm]"""
    mean_forward_um: Micro
    """Mean deviation x̄↑ [µm]"""
    mean_backward_um: Micro | None
    """Mean deviation x̄↓ [µm]"""
    mean_um: Micro
    """Mean of both, x̄; of the forward one alone without the other [µm]"""
    reversal_um: Micro | None
    """Reversal value B, x̄↑ less x̄↓ [µm]"""
    standard_deviation_forward_um: Digits | None
    """s↑ [µm]"""
    standard_deviation_backward_um: Digits | None
    """s↓ [µm]"""
    repeatability_forward_um: Digits | None
    """R↑ = 4 s↑ [µm]"""
    repeatability_backward_um: Digits | None
    """R↓ = 4 s↓ [µm]"""
    repeatability_um: Digits | None
    """Bidirectional repeatability R [µm]"""


@dataclass(frozen=True, eq=False, kw_only=True)
class Positioning(Evaluated):
    """ISO 230-2's figures of the axis (A, E, M, B, R in `figures`) and its displacement error."""

    # The axis, targets [mm], what each direction shows at each of them, the mean of both, reversal
    # and bidirectional repeatability, all of shape (m,) [µm].
    axis: Annotated[str, Field(exclude=True)]
    targets_mm: Annotated[FloatArray, AS_IT_IS, Field(exclude=True)]
    forward: Annotated[RunMeans, AS_IT_IS, Field(exclude=True)]
    backward: Annotated[RunMeans | None, AS_IT_IS, Field(exclude=True)]
    mean_um: Annotated[FloatArray, AS_IT_IS, Field(exclude=True)]
    reversal_um: Annotated[FloatArray | None, AS_IT_IS, Field(exclude=True)]
    bidirectional_repeatability_um: Annotated[FloatArray | None, AS_IT_IS, Field(exclude=True)]

    @shown
    def targets(self) -> list[TargetAnswer]:
        """The values at each target position."""
        forward, backward = self.forward, self.backward
        columns = (
            self.targets_mm,
            forward.mean,
            None if backward is None else backward.mean,
            self.mean_um,
            self.reversal_um,
            forward.standard_deviation,
            None if backward is None else backward.standard_deviation,
            forward.repeatability,
            None if backward is None else backward.repeatability,
            self.bidirectional_repeatability_um,
        )
        absent = [None] * self.targets_mm.size
        lists = (absent if column is None else column.tolist() for column in columns)
        return [TargetAnswer(*row) for row in zip(*lists, strict=True)]


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
    runs = {"forward": as_runs("forward_um", forward_um, targets_mm, "µm")}
    if not _is_empty(backward_um):
        runs["backward"] = as_runs("backward_um", backward_um, targets_mm, "µm")
    return runs


def _is_empty(values: ArrayLike) -> bool:
    return isinstance(values, list | tuple | np.ndarray) and len(values) == 0


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
    # Two runs always lie on a line: nothing is left that tells a drift from chance.
    if means.size < 3 or np.ptp(means) == 0:
        return float(means[-1] - means[0]), 1.0
    from scipy.stats import linregress  # takes half a second to import

    line = linregress(np.arange(means.size), means)
    return float(line.slope) * (means.size - 1), float(line.pvalue)


def _figures_of(ways: list[RunMeans], suffix: str) -> dict[str, float]:
    """E and A over one direction or both; R of one direction."""
    means = np.array([way.mean for way in ways])
    figures = {f"E{suffix}_um": float(np.ptp(means))}
    spreads = [way.standard_deviation for way in ways if way.standard_deviation is not None]
    if len(spreads) == len(ways):
        # ISO 230-2: A = max(mean + 2 s) − min(mean − 2 s), over all directions that are given.
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
        "noise_um": rms(np.array([scatter.noise for scatter in scatters])),
        "run_shift_um": rms(np.array([scatter.shift for scatter in scatters])),
        "noise_degrees_of_freedom": float(sum(scatter.degrees_of_freedom for scatter in scatters)),
    }
    slope = rms(np.array([scatter.slope_per_m for scatter in scatters]))
    if math.isfinite(slope):
        figures["run_slope_um_per_m"] = slope
    drift = drift_of(runs)
    if drift is not None:
        figures["drift_um"] = drift[0]
    if len(scatters) == 2 and ways["forward"].runs == ways["backward"].runs:
        # Run by run: what shifts both directions of a run is not in B, and so not in its scatter.
        of_runs = (runs["forward"] - runs["backward"]).mean(axis=1)
        standard_error = float(of_runs.std(ddof=1)) / math.sqrt(of_runs.size)
        figures["B_mean_standard_error_um"] = standard_error
    return figures


def notes_on(targets_mm: FloatArray, runs: Mapping[str, FloatArray]) -> tuple[str, ...]:
    """Say what departs from the standard, what cannot be seen and what looks wrong.

    Parameters
    ----------
    targets_mm : ndarray, shape (m,) [mm]
        Target positions.
    runs
        Direction to readings, one row for each run [µm].
    """
    notes = _notes_on_the_standard(targets_mm, runs)
    drift = drift_of(runs)
    if drift is not None and drift[1] < SIGNIFICANT:
        notes.append(
            f"The runs drift by {drift[0]:.2f} µm from the first to the last: the axis warms up "
            "or cools down. The means belong to the mean thermal state of the runs, and s, R "
            "and A contain the drift."
        )
    for way, readings in runs.items():
        if len(readings) > 1 and not varies(readings):
            notes.append(
                f"The runs of {way}_um do not differ: they do not show their noise, and standard "
                "errors are those of repeatability_um, or unknown."
            )
        notes += suspiciously_small(f"{way}_um", readings)
    return tuple(notes)


def _notes_on_the_standard(targets_mm: FloatArray, runs: Mapping[str, FloatArray]) -> list[str]:
    notes = []
    fewest = min(len(readings) for readings in runs.values())
    if fewest < RUNS_OF_THE_STANDARD:
        less = "there is no repeatability and no accuracy" if fewest < 2 else "s is less certain"
        notes.append(
            f"ISO 230-2 asks for {RUNS_OF_THE_STANDARD} runs in each direction, got {fewest}: "
            f"{less}."
        )
    required = max(1.0, float(np.ptp(targets_mm)) / MM_PER_M) * TARGETS_OF_THE_STANDARD
    if targets_mm.size < required:
        notes.append(
            f"ISO 230-2 asks for at least {math.ceil(required)} targets here, "
            f"got {targets_mm.size}."
        )
    if "backward" not in runs:
        notes.append("Approached in one direction only: there is no reversal error.")
    steps = np.diff(targets_mm)
    if steps.size > 1 and np.ptp(steps) <= 1e-9 * float(np.abs(targets_mm).max()):
        notes.append(
            f"The targets are evenly spaced: an error whose period divides {steps[0]:g} mm "
            "cannot be seen."
        )
    return notes
