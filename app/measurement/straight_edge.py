"""Deviations of a machined edge from its reference line, and how sure they are."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from app.arrays import FloatArray
from app.measurement.reference_line import (
    covariance_through,
    line_through,
    slope_of,
    without_line,
)


@dataclass(frozen=True, slots=True, eq=False)
class StraightEdge:
    """Points along an edge without their reference line.

    Parameters
    ----------
    positions_mm : ndarray, shape (m,) [mm]
        Where.
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
            "residual_rms_um": math.sqrt(float(np.mean(deviations**2))),
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

    Returns
    -------
    StraightEdge

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
