"""Corner values of the volumetric error for a controller that interpolates (8.101–8.104).

In a cell the corners are numbered 1 (0, 0, 0), 2 (1, 0, 0), 3 (1, 1, 0), 4 (0, 1, 0)
and 5 to 8 the same at z = 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray, IntArray, frozen
from app.errors import InvalidContent
from app.geometry.error_field import ErrorField
from app.geometry.volumetric_error import NO_TOOL, as_points
from app.geometry.work_volume import points_of

CORNERS: Final = (
    (0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0),
    (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1),
)  # fmt: skip
"""The chapter's corners 1 to 8 of a cell, as steps along x, y, z."""


@dataclass(frozen=True, slots=True, eq=False)
class ErrorGrid:
    """Errors at the nodes of a rectangular grid.

    Parameters
    ----------
    x_mm, y_mm, z_mm : ndarray, shapes (i,), (j,), (k,) [mm]
        Strictly increasing, at least two each.
    errors_um : ndarray, shape (i, j, k, 3) [µm]
        Actual minus nominal at the nodes; the compensation is minus that.
    """

    x_mm: FloatArray
    y_mm: FloatArray
    z_mm: FloatArray
    errors_um: FloatArray

    @property
    def nodes_mm(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The three coordinates in the order x, y, z [mm]."""
        return (self.x_mm, self.y_mm, self.z_mm)

    def corners(self, i: int, j: int, k: int) -> FloatArray:
        """Give the eight corner values of one cell in the chapter's numbering.

        Parameters
        ----------
        i, j, k
            Index of the cell along x, y, z, from 0.

        Returns
        -------
        ndarray, shape (8, 3) [µm]
            C1 to C8 of (8.101), for x, y and z.
        """
        return np.array([self.errors_um[i + a, j + b, k + c] for a, b, c in CORNERS])

    def at(self, points_mm: ArrayLike) -> FloatArray:
        """Interpolate in the cell's eight corners (8.101–8.104).

        Parameters
        ----------
        points_mm : array-like, shape (n, 3) [mm]
            Where; outside the grid the value of the nearest point of its surface.

        Returns
        -------
        ndarray, shape (n, 3) [µm]
            What a controller that has the grid takes for the error.

        Examples
        --------
        >>> corner = np.zeros((2, 2, 2, 3))
        >>> corner[1, 1, 1] = [8.0, 0.0, -16.0]
        >>> sides = np.array([0.0, 100.0])
        >>> ErrorGrid(sides, sides, sides, corner).at([[50.0, 50.0, 50.0]]).tolist()
        [[1.0, 0.0, -2.0]]
        """
        # (8.103) and (8.104) as printed divide by the difference of corners 1 and 2, which differ
        # in x alone; the shares of y and z run to corners 4 and 5.
        placed = [
            place_in_cells(nodes, coordinate)
            for nodes, coordinate in zip(self.nodes_mm, as_points(points_mm).T, strict=True)
        ]
        (i, x), (j, y), (k, z) = placed
        errors = np.zeros((len(x), 3))
        for a, b, c in CORNERS:
            share = (x if a else 1 - x) * (y if b else 1 - y) * (z if c else 1 - z)
            errors += share[:, None] * self.errors_um[i + a, j + b, k + c]
        return errors


def sample_grid(
    field: ErrorField,
    x_mm: ArrayLike,
    y_mm: ArrayLike,
    z_mm: ArrayLike,
    tool_offset_mm: ArrayLike = NO_TOOL,
) -> ErrorGrid:
    """Give the volumetric error at the nodes of a rectangular grid.

    Parameters
    ----------
    x_mm, y_mm, z_mm : array-like, shapes (i,), (j,), (k,) [mm]
        Coordinates of the nodes, strictly increasing, at least two each.
    tool_offset_mm : array-like, shape (3,) [mm]

    Raises
    ------
    InvalidContent
        If coordinates are too few, not finite or not increasing, or the field has
        several thermal states.
    """
    field.expect_one_state()
    x, y, z = (
        checked_nodes(name, nodes)
        for name, nodes in (("x_mm", x_mm), ("y_mm", y_mm), ("z_mm", z_mm))
    )
    errors_um, _ = field.at(points_of(x, y, z), tool_offset_mm)
    return ErrorGrid(x, y, z, errors_um.reshape(x.size, y.size, z.size, 3))


def place_in_cells(nodes_mm: FloatArray, coordinates_mm: FloatArray) -> tuple[IntArray, FloatArray]:
    """Find the cell of each coordinate and the share of the way through it (8.102–8.104).

    Parameters
    ----------
    nodes_mm : ndarray, shape (k,) [mm]
        Strictly increasing, at least two.
    coordinates_mm : ndarray, shape (n,) [mm]
        Where; outside the nodes the nearest end counts.

    Returns
    -------
    cell : ndarray, shape (n,)
        From 0 to k − 2.
    share : ndarray, shape (n,)
        0 at the cell's lower node, 1 at its upper one.
    """
    inside = np.clip(coordinates_mm, nodes_mm[0], nodes_mm[-1])
    cell = np.clip(np.searchsorted(nodes_mm, inside, side="right") - 1, 0, nodes_mm.size - 2)
    return cell, (inside - nodes_mm[cell]) / (nodes_mm[cell + 1] - nodes_mm[cell])


def checked_nodes(name: str, nodes_mm: ArrayLike) -> FloatArray:
    """Take the coordinates of a grid along one axis.

    Parameters
    ----------
    nodes_mm : array-like, shape (k,) [mm]

    Returns
    -------
    ndarray, shape (k,) [mm]

    Raises
    ------
    InvalidContent
        If there are fewer than two, or they are not finite or not increasing.
    """
    nodes = frozen(nodes_mm)
    if nodes.ndim != 1 or nodes.size < 2:
        raise InvalidContent.of_field(
            name, f"expected at least 2 coordinates in mm, got {nodes.size}"
        )
    if not np.isfinite(nodes).all() or (np.diff(nodes) <= 0).any():
        raise InvalidContent.of_field(
            name, f"expected finite, strictly increasing coordinates in mm, got {nodes.tolist()}"
        )
    return nodes
