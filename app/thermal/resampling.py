"""Tables of one component from several maps, brought to the same positions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

import numpy as np

from app.arrays import FloatArray
from app.errors import Conflict
from app.thermal.error_map import ComponentTable


def common_positions(tables: Sequence[ComponentTable]) -> FloatArray:
    """Unite the positions of one component's tables inside the range that all of them cover.

    Parameters
    ----------
    tables
        One component's tables, at least one. A table with one position does not
        depend on position and limits nothing.

    Returns
    -------
    ndarray, shape (n,) [mm]
        Increasing; empty for a component that has no argument.

    Raises
    ------
    Conflict
        If tables that depend on position have no range in common. One shared point
        is none: the result would pass for a table that does not depend on position.

    Examples
    --------
    >>> from app.geometry.components import COMPONENTS
    >>> exx = COMPONENTS["EXX"]
    >>> common_positions([
    ...     ComponentTable.make(exx, [0.0, 1.0, 2.0], [0.0, 100.0, 200.0]),
    ...     ComponentTable.make(exx, [0.0, 1.0], [50.0, 150.0]),
    ... ]).tolist()
    [50.0, 100.0, 150.0]
    """
    union = reduce(np.union1d, [table.positions_mm for table in tables])
    ranges = [table.positions_mm for table in tables if table.depends_on_position]
    if not ranges:
        return union
    low = max(float(positions[0]) for positions in ranges)
    high = min(float(positions[-1]) for positions in ranges)
    if low >= high:
        raise Conflict(
            f"expected the maps' tables of {tables[0].component.code} to share a range of "
            f"positions, came a highest start of {low:g} mm and a lowest end of {high:g} mm"
        )
    return union[(union >= low) & (union <= high)]


def sample_table(
    table: ComponentTable, positions_mm: FloatArray, *, backward: bool = False
) -> FloatArray:
    """Interpolate a table linearly to positions inside its range.

    Parameters
    ----------
    table
        The table; its own positions are reproduced exactly.
    positions_mm : ndarray, shape (n,) [mm]
        Where; not used for a component that has no argument.
    backward
        Whether the errors of the negative approach are meant. A table without
        them serves both directions.

    Returns
    -------
    ndarray, shape (n,), or (1,) without argument [the component's unit]

    Examples
    --------
    >>> from app.geometry.components import COMPONENTS
    >>> table = ComponentTable.make(COMPONENTS["EXX"], [0.0, 4.0], [0.0, 100.0])
    >>> sample_table(table, np.array([25.0])).tolist()
    [1.0]
    """
    values = table.errors
    if backward and table.backward_errors is not None:
        values = table.backward_errors
    if not table.component.is_table:
        return values
    if not table.depends_on_position:
        return np.full(positions_mm.size, values[0])
    return np.interp(positions_mm, table.positions_mm, values)
