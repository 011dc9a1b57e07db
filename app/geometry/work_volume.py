"""The work volume: the box in which a machine's accuracy is stated."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray
from app.errors import InvalidContent
from app.geometry.components import LINEAR_LETTERS

Range = tuple[float, float]


@dataclass(frozen=True, slots=True)
class WorkVolume:
    """A box along the axes.

    Parameters
    ----------
    x_mm, y_mm, z_mm
        Lowest and highest coordinate [mm]; equal where there is no such axis.

    Raises
    ------
    InvalidContent
        If an end is not finite, or the lowest lies above the highest.

    Examples
    --------
    >>> WorkVolume((0.0, 300.0), (0.0, 400.0), (0.0, 1200.0)).diagonal_mm
    1300.0
    """

    x_mm: Range
    y_mm: Range
    z_mm: Range

    def __post_init__(self) -> None:
        for letter, (low, high) in zip(LINEAR_LETTERS, self.ranges_mm, strict=True):
            if not (math.isfinite(low) and math.isfinite(high) and low <= high):
                raise InvalidContent.of_field(
                    f"{letter}_mm",
                    f"expected a lowest and a highest {letter} in mm, got {low:g} to {high:g} mm",
                )

    @property
    def ranges_mm(self) -> tuple[Range, Range, Range]:
        """The three ranges in the order x, y, z [mm]."""
        return (self.x_mm, self.y_mm, self.z_mm)

    @property
    def diagonal_mm(self) -> float:
        """Length of the body diagonals [mm]."""
        return math.hypot(*(high - low for low, high in self.ranges_mm))

    def lattice(self, points_per_axis: int) -> FloatArray:
        """Spread points evenly over the box, its faces, edges and corners included.

        Parameters
        ----------
        points_per_axis
            At least 2; an axis whose ends are equal has one.

        Returns
        -------
        ndarray, shape (n, 3) [mm]
            z varies fastest.
        """
        if points_per_axis < 2:
            raise InvalidContent.of_field(
                "points_per_axis", f"expected at least 2, got {points_per_axis}"
            )
        return points_of(
            *(
                np.linspace(low, high, points_per_axis if high > low else 1)
                for low, high in self.ranges_mm
            )
        )


def points_of(x_mm: ArrayLike, y_mm: ArrayLike, z_mm: ArrayLike) -> FloatArray:
    """Make all points with the given coordinates.

    Parameters
    ----------
    x_mm, y_mm, z_mm : array-like, shapes (i,), (j,), (k,) [mm]
        Coordinates along each axis.

    Returns
    -------
    ndarray, shape (i·j·k, 3) [mm]
        z varies fastest, so that a reshape to (i, j, k, 3) finds them again.

    Examples
    --------
    >>> points_of([0.0, 1.0], [5.0], [7.0]).tolist()
    [[0.0, 5.0, 7.0], [1.0, 5.0, 7.0]]
    """
    return np.stack(np.meshgrid(x_mm, y_mm, z_mm, indexing="ij"), axis=-1).reshape(-1, 3)
