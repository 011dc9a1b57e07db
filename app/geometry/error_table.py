"""One component's table of errors over positions, checked and as arrays."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray, frozen
from app.errors import InvalidContent, counted
from app.geometry.axis_table import CLOSEST_MM, FARTHEST_MM
from app.geometry.components import COMPONENTS


class Table(NamedTuple):
    """One component's errors at one thermal state or at several.

    `positions_mm` has shape (k,), strictly increasing, and is empty for a single value
    (squareness, or an error that does not depend on position). `values` has shape (k,),
    or (s, k) for s states; k is 1 for a single value.
    """

    positions_mm: ArrayLike
    values: ArrayLike


PackedTable: TypeAlias = tuple[FloatArray, FloatArray]
"""Positions (k,) or (0,) and values (s, k), checked."""


def checked_table(code: str, table: Table) -> PackedTable:
    """Take one table as arrays.

    Parameters
    ----------
    table
        Its positions [mm] and values [the component's unit].

    Returns
    -------
    positions, values : ndarray, shapes (k,) or (0,), and (k,) or (s, k)

    Raises
    ------
    InvalidContent
        If something is not finite, not increasing or of unequal length.
    """
    if code not in COMPONENTS:
        raise InvalidContent.of_field(code, f"expected an error component's code, got {code!r}")
    positions, values = frozen(table.positions_mm), frozen(table.values)
    unit = COMPONENTS[code].unit.symbol
    bounded(code, positions)
    if not np.isfinite(values).all():
        raise InvalidContent.of_field(code, f"expected finite values in {unit}, got {values}")
    if positions.ndim != 1 or (np.diff(positions) < CLOSEST_MM).any():
        raise InvalidContent.of_field(
            code,
            f"expected increasing positions in mm, at least {CLOSEST_MM:g} mm apart, "
            f"got {positions.tolist()}",
        )
    expected = max(positions.size, 1)
    if values.ndim > 2 or values.shape[-1] != expected:
        raise InvalidContent.of_field(
            code,
            f"expected {counted(expected, 'value')} in {unit}, one for each position, or "
            f"so many for each thermal state, got an array of shape {values.shape}",
        )
    return positions, values


def union_of_positions(tables: Iterable[PackedTable]) -> FloatArray:
    """Unite the positions of tables that depend on position.

    Returns
    -------
    ndarray, shape (k,) [mm]
        Increasing; empty where no table depends on position.
    """
    varying = [positions for positions, _ in tables if positions.size > 1]
    return np.unique(np.concatenate(varying)) if varying else np.empty(0)


def bounded(field: str, array_mm: FloatArray) -> FloatArray:
    """Refuse lengths that are not finite or far beyond any machine.

    Parameters
    ----------
    array_mm : ndarray, of any shape [mm]
        Coordinates or lengths.

    Returns
    -------
    ndarray, same shape [mm]
        The same array.

    Raises
    ------
    InvalidContent
        If there is such a number; the sentence says where the first of them is.
    """
    if array_mm.size and not (array_mm.min() > -FARTHEST_MM and array_mm.max() < FARTHEST_MM):
        wrong = np.argwhere(~(np.abs(array_mm) < FARTHEST_MM))[0].tolist()
        raise InvalidContent.of_field(
            field,
            f"expected finite numbers within ±{FARTHEST_MM:g} mm, "
            f"got {array_mm[tuple(wrong)]:g} mm at index {wrong}",
        )
    return array_mm
