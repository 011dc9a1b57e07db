"""Straightness of an axis from an edge that it machined, measured on a coordinate machine.

The points along an edge of a finished part (ISO 10791-7) deviate from a straight line as
the tool did; P. Sratong-on et al. compare them with what the machine's error model says
at the same positions.

References
----------
P. Sratong-on, L. Vongsarngpigoon, W. Nerdnoi, W. Thasana, *Error parameters of milling
machine by measurement of machined parts* (Thai-Nichi Institute of Technology), section IV
and Table II. ISO 10791-7, *Accuracy of finished test pieces*.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from app.answer import Answer
from app.arrays import FloatArray, rms
from app.errors import InvalidContent
from app.geometry.components import Component
from app.geometry.measuring_line import MeasuringLines
from app.measurement.outliers import far_from_the_rest
from app.measurement.reference_line import (
    StraightLine,
    covariance_through,
    expect_line,
    line_through,
    slope_of,
    without_line,
)
from app.measurement.result import Evaluated, MeasurementResult
from app.measurement.stated_numbers import as_standard_deviation, suspiciously_small
from app.measurement.stated_runs import as_positions, as_runs, as_straightness, stated_line
from app.rounding import Digits, Micro, listed
from app.thermal.correlation import fisher_interval, pearson_r
from app.thermal.error_map import ComponentTable


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Comparison(Answer):
    """What the part says against what the model says."""

    predicted_um: Annotated[FloatArray, listed(1)]
    """The model's error at each position [µm]"""
    bias_um: Micro
    """Mean of measured minus predicted [µm]"""
    slope_difference_um_per_m: Micro
    """Slope of measured minus predicted [µm/m]"""
    rms_difference_um: Micro
    """Root mean square of measured minus predicted, as both came [µm]"""
    rms_without_line_um: Micro
    """The same without the reference line of both [µm]"""
    correlation: Annotated[Digits | None, Field(alias="r")]
    """Correlation of both without their lines"""
    # With one pair less for the slope that both have lost; None of fewer than five points.
    interval: Annotated[Sequence[Digits] | None, Field(alias="confidence_95")]
    """Its 95 % confidence interval"""
    # Of both as they came: a slope in common makes it large.
    correlation_as_came: Annotated[float | None, Field(exclude=True)]


@dataclass(frozen=True, eq=False, kw_only=True)
class MachinedPart(Evaluated):
    """The straightness of the edge, and how it compares with the model."""

    straightness_um: Micro
    """Range of the deviations from the line [µm]"""
    slope_um_per_m: Micro
    """Slope that was taken out [µm/m]: alignment on the coordinate machine, and whatever squareness
    the edge has"""
    # Predicted ones that are far from the rest are kept, too; the notes tell of them.
    suspicious_measured: Annotated[Sequence[int], Field(alias="suspicious")]
    """Indices of measured points far from the rest, from 0; they are kept"""
    comparison: Comparison | None
    """With the active model at `temperatures_c`; null where there is no model"""


def evaluate_machined_part(
    component: str,
    positions_mm: ArrayLike,
    measured_um: ArrayLike,
    predicted_um: ArrayLike | None = None,
    *,
    line: StraightLine = "least-squares",
    measuring_line_mm: ArrayLike | None = None,
    tool_offset_mm: ArrayLike = (0.0, 0.0, 0.0),
    repeatability_um: float | None = None,
) -> MachinedPart:
    """Take the straightness of an axis from points along an edge that it machined.

    Parameters
    ----------
    component
        A straightness component such as `EXY`: points of an edge along y, deviations in x.
    positions_mm : array-like, shape (m,) [mm]
        Where along the axis, strictly increasing, at least three.
    measured_um : array-like, shape (m,), or (n, m) for repeated passes [µm]
        Actual minus nominal position of the edge.
    predicted_um : array-like, shape (m,), optional [µm]
        What the model says there.
    line
        `least-squares` (regression, as the source) or `end-points`.
    measuring_line_mm, tool_offset_mm : array-like, shape (3,), optional [mm]
        A point of the machine's path along the edge, and the tool offset it was cut with.
    repeatability_um
        Standard deviation of one point [µm], for one pass.

    Returns
    -------
    MachinedPart
        The component's errors are the deviations from the line.

    Raises
    ------
    InvalidContent
        If the component is no straightness, or numbers are missing, not finite or so large
        that they cannot be deviations in µm.

    Notes
    -----
    With the projection L that takes the line out, the covariance is σ² L Lᵀ/n. Repeated
    passes lose a line each, since each is aligned anew, and their scatter gives σ² with
    (n − 1)(m − 2) degrees of freedom. One pass cannot tell form from noise: its residual
    standard deviation (m − 2 degrees of freedom) contains both, and σ is
    `repeatability_um`.

    Examples
    --------
    >>> part = evaluate_machined_part("EXY", [0.0, 50.0, 100.0], [0.0, 3.0, 0.0])
    >>> part.straightness_um, part.result.tables[0].errors.round(9).tolist()
    (3.0, [-1.0, 2.0, -1.0])
    """
    straightness = as_straightness(component)
    positions = as_positions("positions_mm", positions_mm)
    expect_line("line", line)
    if positions.size < 3:
        raise InvalidContent.of_field(
            "positions_mm",
            f"expected at least 3 positions in mm along the edge, got {positions.size}",
        )
    passes = as_runs("measured_um", measured_um, positions, "µm")
    spread = as_standard_deviation("repeatability_um", repeatability_um, "µm")
    predicted = None
    if predicted_um is not None:
        predicted = as_runs("predicted_um", predicted_um, positions, "µm").mean(axis=0)
    lines: MeasuringLines = {}
    if measuring_line_mm is not None and straightness.axis:
        axis = straightness.axis
        lines = {axis: stated_line(axis, measuring_line_mm, tool_offset_mm)}
    edge = straight_edge(positions, passes, line, spread)
    notes = [*_notes(line, edge), *suspiciously_small("measured_um", passes)]
    return _part(straightness, edge, predicted, line, lines, notes)


def _part(
    component: Component,
    edge: StraightEdge,
    predicted: FloatArray | None,
    line: StraightLine,
    lines: MeasuringLines,
    notes: list[str],
) -> MachinedPart:
    """Judge the edge's points, and those of the model beside them."""
    figures = edge.figures()
    suspicious = far_from_the_rest(edge.positions_mm, edge.measured_um)
    notes += _suspicion("measured_um", edge.positions_mm, edge.measured_um, suspicious)
    comparison: Comparison | None = None
    if predicted is not None:
        comparison = _compare(edge, predicted, line)
        figures |= _figures_of_comparison(comparison)
        far = far_from_the_rest(edge.positions_mm, predicted)
        notes += _suspicion("predicted_um", edge.positions_mm, predicted, far)
    table = ComponentTable.make(
        component, edge.deviations_um, edge.positions_mm, covariance=edge.covariance
    )
    return MachinedPart(
        straightness_um=edge.straightness_um,
        slope_um_per_m=edge.slope_um_per_m,
        comparison=comparison,
        suspicious_measured=suspicious,
        result=MeasurementResult((table,), figures, tuple(notes), lines),
    )


def _compare(edge: StraightEdge, predicted: FloatArray, line: StraightLine) -> Comparison:
    difference = edge.measured_um - predicted
    straightened = without_line(edge.positions_mm, line) @ predicted
    r = _correlation(edge.deviations_um, straightened)
    return Comparison(
        predicted_um=predicted,
        bias_um=float(difference.mean()),
        slope_difference_um_per_m=slope_of(edge.positions_mm, difference),
        rms_difference_um=rms(difference),
        rms_without_line_um=rms(edge.deviations_um - straightened),
        correlation=r,
        interval=None if r is None else fisher_interval(r, predicted.size - 1),
        correlation_as_came=_correlation(edge.measured_um, predicted),
    )


def _correlation(first: FloatArray, other: FloatArray) -> float | None:
    """Pearson's r, or None where one of the two does not vary beyond rounding."""
    for values in (first, other):
        if np.ptp(values) <= 1e-9 * max(float(np.abs(first).max()), float(np.abs(other).max())):
            return None
    return pearson_r(first, other)


def _figures_of_comparison(comparison: Comparison) -> dict[str, float]:
    figures = {
        "bias_um": comparison.bias_um,
        "slope_difference_um_per_m": comparison.slope_difference_um_per_m,
        "rms_difference_um": comparison.rms_difference_um,
        "rms_without_line_um": comparison.rms_without_line_um,
    }
    if comparison.correlation is not None:
        figures["correlation"] = comparison.correlation
    if comparison.interval is not None:
        figures["correlation_low"], figures["correlation_high"] = comparison.interval
    if comparison.correlation_as_came is not None:
        figures["correlation_as_came"] = comparison.correlation_as_came
    return figures


def _notes(line: str, edge: StraightEdge) -> list[str]:
    notes = [
        f"The reference line is the {line.replace('-', ' ')} line: the edge's slope is taken out, "
        "so squareness and the part's alignment are not seen. Cutting forces, tool wear and "
        "the part's own temperature are in the deviations."
    ]
    if edge.noise_um is None:
        notes.append(
            "One pass without a stated repeatability: form and noise cannot be told apart, so "
            "there are no standard errors."
        )
    return notes


def _suspicion(
    field: str, positions_mm: FloatArray, values: FloatArray, outliers: tuple[int, ...]
) -> list[str]:
    if not outliers:
        return []
    places = ", ".join(f"{values[i]:g} µm at {positions_mm[i]:g} mm" for i in outliers)
    return [f"Suspicious in {field}: {places}; far from the line through the others, and kept."]


@dataclass(frozen=True, slots=True, eq=False)
class StraightEdge:
    """Points along an edge without their reference line.

    Parameters
    ----------
    positions_mm : ndarray, shape (m,) [mm]
    measured_um : ndarray, shape (m,) [µm]
        Mean of all passes, as it came.
    deviations_um : ndarray, shape (m,) [µm]
        The same without its line.
    noise_um
        Standard deviation of one point [µm]; None where nothing is known.
    degrees_of_freedom
        Of the noise; 0 where it was stated.
    covariance : ndarray, shape (m, m), or None [µm²]
        Of the deviations.
    """

    positions_mm: FloatArray
    measured_um: FloatArray
    deviations_um: FloatArray
    noise_um: float | None
    degrees_of_freedom: int
    covariance: FloatArray | None

    @property
    def straightness_um(self) -> float:
        """Range of the deviations."""
        return float(np.ptp(self.deviations_um))

    @property
    def slope_um_per_m(self) -> float:
        """Slope that was taken out."""
        return slope_of(self.positions_mm, self.measured_um - self.deviations_um)

    def figures(self) -> dict[str, float]:
        """Sum up the edge.

        Returns
        -------
        dict
            The unit is in each name.
        """
        deviations = self.deviations_um
        regression = without_line(self.positions_mm, "least-squares") @ deviations
        freedom = deviations.size - 2
        figures = {
            "straightness_um": self.straightness_um,
            "slope_um_per_m": self.slope_um_per_m,
            "residual_rms_um": rms(deviations),
            "residual_standard_deviation_um": math.sqrt(float((regression**2).sum()) / freedom),
        }
        if self.covariance is not None:
            figures["straightness_standard_error_um"] = self._standard_error(self.covariance)
        if self.noise_um is not None:
            figures["noise_um"] = self.noise_um
            figures["noise_degrees_of_freedom"] = float(self.degrees_of_freedom)
        return figures

    def _standard_error(self, covariance: FloatArray) -> float:
        """Of the range: of the difference of its two extreme points."""
        between = np.zeros(self.deviations_um.size)
        between[self.deviations_um.argmax()] += 1
        between[self.deviations_um.argmin()] -= 1
        return math.sqrt(max(float(between @ covariance @ between), 0.0))


def straight_edge(
    positions_mm: FloatArray, passes_um: FloatArray, line: str, repeatability_um: float | None
) -> StraightEdge:
    """Take the reference line out of the points along an edge.

    Parameters
    ----------
    positions_mm : ndarray, shape (m,) [mm]
        Increasing, at least three.
    passes_um : ndarray, shape (n, m) [µm]
        The points of each pass.
    line
        `least-squares` or `end-points`.
    repeatability_um
        Standard deviation of one point [µm], used for one pass alone.

    Examples
    --------
    >>> edge = straight_edge(np.array([0.0, 1.0, 3.0]), np.array([[0, 5.0, 6]]), "end-points", None)
    >>> edge.deviations_um.tolist(), round(edge.slope_um_per_m, 9)
    ([0.0, 3.0, 0.0], 2000.0)
    """
    measured = passes_um.mean(axis=0)
    alone = len(passes_um) < 2
    noise = repeatability_um if alone else _noise(positions_mm, passes_um)
    rest = without_line(positions_mm, line)
    return StraightEdge(
        positions_mm=positions_mm,
        measured_um=measured,
        deviations_um=rest @ measured,
        noise_um=noise,
        degrees_of_freedom=(len(passes_um) - 1) * (measured.size - 2),
        covariance=None if noise is None else covariance_through(rest, noise**2 / len(passes_um)),
    )


def _noise(positions_mm: FloatArray, passes_um: FloatArray) -> float:
    """Standard deviation of one point, from passes that are each aligned anew."""
    n, m = passes_um.shape
    scatter = passes_um - passes_um.mean(axis=0)
    scatter = scatter - scatter @ line_through(positions_mm, "least-squares")
    return math.sqrt(float((scatter**2).sum()) / ((n - 1) * (m - 2)))
