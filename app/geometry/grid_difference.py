"""How far a grid that is interpolated trilinearly lies from the model between its nodes.

Inside the small boxes that the nodes of the tables and of the grid cut, the model is a
polynomial (`polynomial_pieces`) and interpolation is trilinear, so their difference is
a polynomial of the model's degrees.

A polynomial lies in the convex hull of its Bernstein coefficients. Along a coordinate
of degree 1 these are its values at the ends, so that the largest difference is found
exactly, at a corner of a small box. Along one of degree 2 the middle coefficient is
2 f(middle) − (f(left) + f(right))/2, which no value exceeds: a bound that is proven,
and above the largest difference by no more than 1/16 of what a parabola over the whole
cell contributes, because cells are cut in at least four.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray
from app.errors import InvalidContent
from app.geometry.components import LINEAR_LETTERS
from app.geometry.error_field import ErrorField
from app.geometry.grid import ErrorGrid, place_in_cells
from app.geometry.polynomial_pieces import bernstein_coefficients, cut, degree_along
from app.geometry.volumetric_error import NO_TOOL
from app.geometry.work_volume import points_of

POINTS_AT_ONCE: Final = 200_000
"""Larger boxes are halved, so that memory stays small."""

MOST_POINTS: Final = 20_000_000
"""More are not looked at: some seconds of one processor."""

Coordinates: TypeAlias = tuple[FloatArray, ...]
"""Along x, y and z [mm]."""


@dataclass(frozen=True, slots=True, eq=False)
class GridDifference:
    """The largest difference between interpolation and model inside each cell.

    Parameters
    ----------
    bound_um : ndarray, shape (i − 1, j − 1, k − 1, 3) [µm]
        No difference in x, y or z inside the cell is larger.
    attained_um : ndarray, same shape [µm]
        A difference that the cell does have.
    bound_length_um, attained_length_um : ndarray, shape (i − 1, j − 1, k − 1) [µm]
        The same for the length of the difference's vector.
    """

    bound_um: FloatArray
    attained_um: FloatArray
    bound_length_um: FloatArray
    attained_length_um: FloatArray

    @property
    def largest_um(self) -> float:
        """Length of vector that the difference exceeds nowhere in the grid [µm]."""
        return float(self.bound_length_um.max())


def grid_difference(
    field: ErrorField, grid: ErrorGrid, tool_offset_mm: ArrayLike = NO_TOOL
) -> GridDifference:
    """Find the largest difference between a grid's interpolation and the model.

    Parameters
    ----------
    field
        The model: the errors at one thermal state.
    tool_offset_mm : array-like, shape (3,) [mm]
        Tool offset T.

    Returns
    -------
    GridDifference
        Exact where the model is of degree 1 along every coordinate, else a proven
        bound with the largest value found beside it (mostly the same number, because
        the difference is largest at a table's node).

    Raises
    ------
    InvalidContent
        If the field has several thermal states, or the nodes of its tables and of the grid cut
        the volume into too many pieces.

    Notes
    -----
    The module's docstring gives the proof. Rounding of double precision is not part
    of it.
    """
    field.expect_one_state()
    degrees = [degree_along(field, axis) for axis in LINEAR_LETTERS]
    pieces = [
        cut(nodes, field.nodes_mm(axis), degree)
        for axis, nodes, degree in zip(LINEAR_LETTERS, grid.nodes_mm, degrees, strict=True)
    ]
    points = math.prod(coordinates.size for coordinates in pieces)
    if points > MOST_POINTS:
        raise InvalidContent.of_field(
            "x_mm",
            f"expected a grid and tables that have at most {MOST_POINTS} nodes, ends and middles "
            f"together, where the largest difference is looked for, got {points}: ask for a part "
            "of the volume",
        )
    tool = np.asarray(tool_offset_mm, dtype=np.float64)
    largest = np.zeros((*(nodes.size - 1 for nodes in grid.nodes_mm), 8))
    for box in _boxes(tuple(pieces)):
        interpolated = grid.errors_um
        for i, coordinates in enumerate(box):
            interpolated = interpolate_along(interpolated, i, grid.nodes_mm[i], coordinates)
        difference = interpolated - errors_on(field, box, tool)
        _collect(largest, difference, degrees, grid, box)
    return GridDifference(
        bound_um=largest[..., :3],
        bound_length_um=largest[..., 3],
        attained_um=largest[..., 4:7],
        attained_length_um=largest[..., 7],
    )


def errors_on(
    field: ErrorField, coordinates_mm: Coordinates, tool_offset_mm: FloatArray
) -> FloatArray:
    """Ask the model at all points with the given coordinates: shape (i, j, k, 3) [µm].

    Parameters
    ----------
    tool_offset_mm : ndarray, shape (3,) [mm]
    """
    errors_um, _ = field.at(points_of(*coordinates_mm), tool_offset_mm)
    return errors_um.reshape(*(c.size for c in coordinates_mm), 3)


def interpolate_along(
    values: FloatArray, dimension: int, nodes_mm: FloatArray, coordinates_mm: FloatArray
) -> FloatArray:
    """Interpolate linearly along one dimension: one third of (8.101).

    Parameters
    ----------
    values : ndarray, with shape (k,) along that dimension
        Values at the nodes.
    nodes_mm : ndarray, shape (k,) [mm]
        Coordinates of the nodes.
    coordinates_mm : ndarray, shape (n,) [mm]
        Where the interpolation is asked.

    Returns
    -------
    ndarray, with shape (n,) along that dimension
    """
    cell, share = place_in_cells(nodes_mm, coordinates_mm)
    share = share.reshape([-1 if d == dimension else 1 for d in range(values.ndim)])
    below = values.take(cell, axis=dimension)
    above = values.take(cell + 1, axis=dimension)
    mixed: FloatArray = (1 - share) * below + share * above
    return mixed


def with_length(difference: FloatArray) -> FloatArray:
    """Give absolute values in x, y, z and the vector's length beside them: shape (…, 4).

    Parameters
    ----------
    difference : ndarray, shape (…, 3) [µm]
        Vectors.
    """
    length = np.sqrt(np.einsum("...d,...d->...", difference, difference))
    return np.concatenate([np.abs(difference), length[..., None]], axis=-1)


def _boxes(pieces: Coordinates) -> list[Coordinates]:
    """Halve until few enough points are left; neighbours share their common face."""
    sizes = [coordinates.size for coordinates in pieces]
    widest = int(np.argmax(sizes))
    # An even index: along a coordinate of degree 2 the ends of pieces have even ones, and a middle
    # must not become an end.
    middle = (sizes[widest] // 4) * 2
    if np.prod(sizes) <= POINTS_AT_ONCE or sizes[widest] < 5:
        return [pieces]
    halves = []
    for part in (slice(None, middle + 1), slice(middle, None)):
        coordinates = list(pieces)
        coordinates[widest] = pieces[widest][part]
        halves += _boxes(tuple(coordinates))
    return halves


def _collect(
    largest: FloatArray,
    difference: FloatArray,
    degrees: Sequence[int],
    grid: ErrorGrid,
    box: Coordinates,
) -> None:
    """Raise the cells' largest values (bound, attained) to those of a box."""
    bound = with_length(bernstein_coefficients(difference, degrees))
    bounds = np.concatenate([bound, with_length(difference)], axis=-1)
    cells = []
    for i, (nodes, coordinates) in enumerate(zip(grid.nodes_mm, box, strict=True)):
        inner = nodes[(nodes > coordinates[0]) & (nodes < coordinates[-1])]
        starts = np.concatenate([[0], np.searchsorted(coordinates, inner)])
        ends = np.append(starts[1:], coordinates.size - 1)
        # A node belongs to the cells on both its sides.
        bounds = np.maximum(np.maximum.reduceat(bounds, starts, axis=i), bounds.take(ends, axis=i))
        # A box may begin inside a cell, where it was halved: the cell is then raised by two boxes.
        first = int(place_in_cells(nodes, coordinates[:1])[0][0])
        cells.append(slice(first, first + starts.size))
    here = tuple(cells)
    largest[here] = np.maximum(largest[here], bounds)
