"""The positions that controllers want: equidistant, powers of two, at most so many."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.errors import InvalidContent

FINEST_MM: Final = 1e-4
"""Positions and spacings of controllers' files are whole multiples of 0.1 µm."""

_ALMOST: Final = 1e-6
"""Share of a step that rounding may cost."""


def even_spacing(positions_mm: FloatArray) -> float | None:
    """Give the spacing of equidistant positions [mm], None where they are not equidistant.

    >>> even_spacing(np.array([0.0, 50.0, 100.0])), even_spacing(np.array([0.0, 50.0, 75.0]))
    (50.0, None)
    """
    gaps = np.diff(positions_mm)
    if not gaps.size or np.abs(gaps - gaps[0]).max() > FINEST_MM / 2:
        return None
    spacing = round(float(positions_mm[-1] - positions_mm[0]) / gaps.size / FINEST_MM) * FINEST_MM
    # A spacing of no whole 0.1 µm would leave the nodes behind along the way.
    if abs(spacing * gaps.size - (positions_mm[-1] - positions_mm[0])) > FINEST_MM / 2:
        return None
    return float(round(spacing, 4))


def choose_spacing(
    tables_mm: Sequence[FloatArray], most: int, stated_mm: float | None, field: str
) -> float:
    """Choose the spacing of one equidistant grid for tables that share it.

    Parameters
    ----------
    tables_mm : sequence of ndarray, each of shape (k,) [mm]
        The tables' own positions.
    most
        So many points a table may have.
    stated_mm
        Spacing that the user wants [mm], or None.

    Returns
    -------
    float [mm]
        What is stated; else the tables' own spacing; else the finest gap of their positions;
        wider where that needs too many points.

    Raises
    ------
    InvalidContent
        If the stated spacing needs too many points, or is no whole multiple of 0.1 µm.
    """
    span = max(float(p[-1] - p[0]) for p in tables_mm)
    if stated_mm is not None:
        if abs(stated_mm / FINEST_MM - round(stated_mm / FINEST_MM)) > _ALMOST:
            raise InvalidContent.of_field(
                field, f"expected a whole multiple of 0.0001 mm, got {stated_mm:g} mm"
            )
        needed = math.ceil(span / stated_mm - _ALMOST) + 1
        if needed > most:
            raise InvalidContent.of_field(
                field,
                f"expected a spacing of at least {_up_to_finest(span / (most - 1)):.4f} mm for at "
                f"most {most} "
                f"points over {span:g} mm, got {stated_mm:g} mm, which needs {needed}",
            )
        return stated_mm
    spacings = {even_spacing(p) for p in tables_mm}
    finest = min(float(np.diff(p).min()) for p in tables_mm)
    wanted = spacings.pop() if len(spacings) == 1 else None
    spacing = max(wanted or finest, span / (most - 1))
    return _up_to_finest(spacing)


def _up_to_finest(length_mm: float) -> float:
    return round(math.ceil(length_mm / FINEST_MM - _ALMOST) * FINEST_MM, 4)


def even_grid(low_mm: float, high_mm: float, spacing_mm: float, through_mm: float) -> FloatArray:
    """Lay an equidistant grid over a range, with a node at a given place.

    Parameters
    ----------
    low_mm, high_mm
        The range [mm], which the grid covers; it may end up to a step beyond.
    through_mm
        Where a node lies, or would lie if the grid went on [mm].

    Returns
    -------
    ndarray, shape (n,) [mm]
        At least two nodes.

    Examples
    --------
    >>> even_grid(-10.0, 110.0, 50.0, 0.0).tolist()
    [-50.0, 0.0, 50.0, 100.0, 150.0]
    """
    first = math.floor((low_mm - through_mm) / spacing_mm + _ALMOST)
    last = max(math.ceil((high_mm - through_mm) / spacing_mm - _ALMOST), first + 1)
    grid: FloatArray = np.round(through_mm + np.arange(first, last + 1) * spacing_mm, 6)
    return grid


def down_to_finest(position_mm: float) -> float:
    """Round a position down to a whole multiple of 0.1 µm [mm].

    >>> down_to_finest(-0.00015)
    -0.0002
    """
    return round(math.floor(position_mm / FINEST_MM + _ALMOST) * FINEST_MM, 4)


def even_positions(
    positions_mm: FloatArray,
    most: int,
    stated_mm: float | None,
    field: str,
    through_mm: float | None = None,
) -> FloatArray:
    """Lay an equidistant grid of at most so many points over a table's positions.

    Parameters
    ----------
    positions_mm : ndarray, shape (k,) [mm]
        The table's own positions, at least two.
    most
        So many points the grid may have.
    stated_mm
        Spacing that the user wants [mm], or None.
    through_mm
        Where a node has to lie [mm]; at the table's begin, to 0.1 µm, where not stated.

    Returns
    -------
    ndarray, shape (n,) [mm]

    Raises
    ------
    InvalidContent
        As `choose_spacing`.

    Examples
    --------
    >>> even_positions(np.array([0.0, 10.0, 100.0]), 5, None, "spacing_mm").tolist()
    [0.0, 25.0, 50.0, 75.0, 100.0]
    """
    low, high = float(positions_mm[0]), float(positions_mm[-1])
    through = down_to_finest(low) if through_mm is None else through_mm
    # A grid that is bound to a place may need a point more at either end.
    for spared in range(min(most - 1, 3)):
        spacing = choose_spacing([positions_mm], most - spared, stated_mm, field)
        grid = even_grid(low, high, spacing, through)
        if grid.size <= most:
            return grid
        if stated_mm is not None:
            break
    raise InvalidContent.of_field(
        field,
        f"expected at most {most} points from {low:g} to {high:g} mm with one at {through:g} mm, "
        f"got a spacing of {spacing:g} mm, which needs {grid.size}",
    )
