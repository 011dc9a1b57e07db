"""The work volume with its errors drawn larger than they are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray
from app.errors import InvalidContent
from app.geometry.components import LINEAR_LETTERS
from app.geometry.error_field import ErrorField
from app.geometry.error_table import bounded
from app.geometry.polynomial_pieces import cut, degree_along
from app.geometry.work_volume import WorkVolume, points_of
from app.pictures.exaggeration import LEAST_UM, automatic_exaggeration, checked_exaggeration
from app.units import UM_PER_MM

MOST_POINTS: Final = 500_000
"""Among more than these the largest error is not searched: half a second would be felt."""


@dataclass(frozen=True, slots=True, eq=False)
class DrawnPoints:
    """Points of the volume, their real errors, and where the picture has them.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3) [mm]
        Nominal positions.
    errors_um : ndarray, shape (n, 3) [µm]
        Actual minus nominal.
    drawn_mm : ndarray, shape (n, 3) [mm]
        Nominal plus exaggeration × error.
    """

    points_mm: FloatArray
    errors_um: FloatArray
    drawn_mm: FloatArray

    @property
    def lengths_um(self) -> FloatArray:
        """Lengths of the errors, shape (n,) [µm]."""
        lengths: FloatArray = np.linalg.norm(self.errors_um, axis=1)
        return lengths


@dataclass(frozen=True, slots=True, eq=False)
class DistortedVolume:
    """A field over a volume, with the factor by which its errors are drawn larger.

    Parameters
    ----------
    tool_offset_mm : ndarray, shape (3,) [mm]
    exaggeration
        Drawn is nominal + exaggeration × error.
    worst_point_mm : ndarray, shape (3,) [mm]
        Where the error is longest.
    largest_um
        How long it is there [µm].
    """

    field: ErrorField
    volume: WorkVolume
    tool_offset_mm: FloatArray
    exaggeration: float
    worst_point_mm: FloatArray
    largest_um: float

    @classmethod
    def make(
        cls,
        field: ErrorField,
        volume: WorkVolume,
        tool_offset_mm: ArrayLike,
        exaggeration: float | None,
    ) -> DistortedVolume:
        """Find the largest error and, where none is given, the factor that shows it.

        Parameters
        ----------
        tool_offset_mm : array-like, shape (3,) [mm]

        Raises
        ------
        InvalidContent
            If the field has several thermal states, the volume is a point, there is
            more than one tool offset, errors are far beyond any machine's, or the
            factor draws no picture.
        """
        field.expect_one_state()
        tool = _one_tool_offset(tool_offset_mm)
        if volume.diagonal_mm == 0:
            raise InvalidContent.of_field(
                "volume", "expected a range in mm along at least one axis, got a point"
            )
        worst_point_mm, largest_um = _worst(field, volume, tool)
        if exaggeration is None:
            exaggeration = automatic_exaggeration(largest_um, volume)
        checked_exaggeration(exaggeration, largest_um, volume)
        return cls(field, volume, tool, exaggeration, worst_point_mm, largest_um)

    @property
    def has_errors(self) -> bool:
        """Whether there is anything but rounding to draw."""
        return self.largest_um >= LEAST_UM

    @property
    def worst(self) -> DrawnPoints:
        """The point with the longest error, as one row."""
        return self.at(self.worst_point_mm[np.newaxis])

    def at(self, points_mm: FloatArray) -> DrawnPoints:
        """Ask the field for errors and draw them larger.

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3) [mm]
            Nominal positions.
        """
        errors_um, _ = self.field.at(points_mm, self.tool_offset_mm)
        drawn_mm = points_mm + self.exaggeration * errors_um / UM_PER_MM
        return DrawnPoints(points_mm, errors_um, drawn_mm)


def _one_tool_offset(tool_offset_mm: ArrayLike) -> FloatArray:
    tool = np.asarray(tool_offset_mm, dtype=np.float64)
    if tool.shape != (3,):
        raise InvalidContent.of_field(
            "tool_offset_mm",
            f"expected one tool offset of 3 coordinates in mm, got an array of shape {tool.shape}",
        )
    return tool


def _worst(field: ErrorField, volume: WorkVolume, tool: FloatArray) -> tuple[FloatArray, float]:
    """Look for the longest error where it must be: at nodes of the tables, or at ends."""
    coordinates = [
        cut(np.array(ends), field.nodes_mm(axis), degree_along(field, axis))
        if ends[0] < ends[1]
        else np.array(ends[:1])
        for axis, ends in zip(LINEAR_LETTERS, volume.ranges_mm, strict=True)
    ]
    points = points_of(*_thinned(coordinates))
    errors_um, _ = field.at(points, tool)
    bounded("errors", errors_um / UM_PER_MM)
    lengths_um = np.linalg.norm(errors_um, axis=1)
    worst = int(lengths_um.argmax())
    return points[worst], float(lengths_um[worst])


def _thinned(coordinates: list[FloatArray]) -> list[FloatArray]:
    """Leave out every second of very many nodes, never an end."""
    thinned = [*coordinates]
    while math.prod(c.size for c in thinned) > MOST_POINTS:
        i = max(range(len(thinned)), key=lambda i: thinned[i].size)
        thinned[i] = np.union1d(thinned[i][::2], thinned[i][-1:])
    return thinned
