"""The pieces of space in which the volumetric error is a polynomial.

Between neighbouring nodes of the axes' tables every error is a straight line of its own
axis' position, and lever arms and slopes multiply it by coordinates. So the error is
a polynomial of degree 1 along most coordinates, and of degree 2 where

- a workpiece-side axis turns its own offset: u · ω(u), unless its measuring line is
  stated (what slopes add to the rotation acts on the whole arm all the same);
- a rotation grows with a coordinate that is also its arm: slope · v · v.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.geometry.components import COMPONENTS
from app.geometry.error_field import ErrorField
from app.geometry.grid import place_in_cells

PARTS_OF_A_CELL: Final = 4
"""Cells are cut at least so finely along a coordinate of degree 2."""


def degree_along(field: ErrorField, axis: str) -> int:
    """Tell the degree of the model along one coordinate between its tables' nodes.

    Returns
    -------
    int
        1 or 2.
    """
    for code, (positions, _) in field.tables.items():
        component = COMPONENTS[code]
        if component.is_rotation and component.axis in field.chain.axes:
            is_arm = axis in field.chain.acts_on(component.axis)
            from_line = component.times is None and axis in field.measuring_lines
            turns_itself = component.axis == axis and not from_line
            # u · ω(u) is a parabola only where ω changes along u: a single value makes it a
            # straight line.
            if is_arm and ((turns_itself and positions.size > 1) or component.times == axis):
                return 2
    return 1


def cut(nodes_mm: FloatArray, tables_mm: FloatArray, degree: int) -> FloatArray:
    """Cut a grid's cells at the tables' nodes, and finer along a coordinate of degree 2.

    Parameters
    ----------
    nodes_mm : ndarray, shape (k,) [mm]
        The grid's nodes along one coordinate.
    tables_mm : ndarray, shape (m,) [mm]
        The nodes of that axis' tables.

    Returns
    -------
    ndarray [mm]
        The ends of the pieces; with degree 2 the middle of each between them.
    """
    inside = tables_mm[(tables_mm > nodes_mm[0]) & (tables_mm < nodes_mm[-1])]
    ends = np.union1d(nodes_mm, inside)
    if degree == 1:
        return ends
    cell, _ = place_in_cells(nodes_mm, ends[:-1])
    shares = np.diff(ends) / np.diff(nodes_mm)[cell]
    # Twice as many, so that every second point is a piece's middle. A share that is a quarter but
    # for rounding is one part, not two.
    halves = 2 * np.ceil(PARTS_OF_A_CELL * shares - 1e-9).astype(int)
    spread = [
        np.linspace(left, right, count, endpoint=False)
        for left, right, count in zip(ends[:-1], ends[1:], halves, strict=True)
    ]
    return np.concatenate([*spread, ends[-1:]])


def bernstein_coefficients(values: FloatArray, degrees: Sequence[int]) -> FloatArray:
    """Turn values at ends and middles into coefficients whose hull holds all values.

    Parameters
    ----------
    values : ndarray, shape (i, j, k, 3)
        Along dimensions of degree 2 every second value is a piece's middle.

    Returns
    -------
    ndarray, same shape
    """
    coefficients = values
    for dimension, degree in enumerate(degrees):
        if degree == 2:
            coefficients = np.moveaxis(coefficients.copy(), dimension, 0)
            # With c0, c1, c2 a parabola is c0 (1 − t)² + 2 c1 t (1 − t) + c2 t²; at the ends it is
            # c0 and c2, and in the middle f = (c0 + 2 c1 + c2)/4: so c1 = 2 f − (c0 + c2)/2. A
            # tensor product is one dimension after the other.
            coefficients[1::2] = (
                2 * coefficients[1::2] - (coefficients[:-2:2] + coefficients[2::2]) / 2
            )
            coefficients = np.moveaxis(coefficients, 0, dimension)
    return coefficients
