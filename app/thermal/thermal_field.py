"""Tables over position at one thermal state or several: what an error field is made of."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

import numpy as np

from app.arrays import FloatArray
from app.geometry.components import LINEAR_LETTERS, Component
from app.geometry.error_table import Table
from app.thermal.group import Member
from app.thermal.group_state import GroupState

Directions = tuple[int, int, int]
"""+1, −1 or 0 (the mean of both) for the direction of approach of x, y, z."""

MEAN_OF_BOTH: Directions = (0, 0, 0)


def thermal_tables(
    states: Sequence[Sequence[GroupState]],
    directions: Directions = MEAN_OF_BOTH,
) -> dict[str, Table]:
    """Lay components out at one thermal state or at several.

    Parameters
    ----------
    directions
        Direction of approach of each axis: which of a bidirectional component's tables
        is meant.

    Returns
    -------
    dict of component code to Table
        With an axis of states in the values if there are several.
    """
    tables: dict[str, Table] = {}
    for of_group in zip(*states, strict=True):
        for place, member in enumerate(of_group[0].members):
            rows = [_table(state, state.members[place], directions) for state in of_group]
            tables[member.component.code] = side_by_side(rows)
    return tables


def _table(state: GroupState, member: Member, directions: Directions) -> Table:
    backward = None if member.backward is None else state.values[member.backward]
    forward = state.values[member.forward]
    return Table(member.positions_mm, by_direction(member.component, forward, backward, directions))


def side_by_side(tables: Sequence[Table]) -> Table:
    """Bring one component's tables of several thermal states to the union of their positions.

    Parameters
    ----------
    tables
        At least one, with values of shape (k,); beyond a table its end values hold.

    Returns
    -------
    Table
        With an axis of states in the values if there are several.
    """
    if len(tables) == 1:
        return tables[0]
    grids = [np.asarray(table.positions_mm) for table in tables]
    union = reduce(np.union1d, grids)
    rows = [
        np.interp(union, grid, np.asarray(table.values))
        if grid.size > 1
        else np.broadcast_to(table.values, (max(union.size, 1),))
        for grid, table in zip(grids, tables, strict=True)
    ]
    return Table(union, np.array(rows))


def by_direction(
    component: Component, forward: FloatArray, backward: FloatArray | None, directions: Directions
) -> FloatArray:
    """Choose a component's table by its axis' direction of approach.

    Parameters
    ----------
    forward, backward : ndarray, shape (k,)
        Its errors approached in either direction, None where they are the same.

    Returns
    -------
    ndarray, shape (k,)
        The mean of both where the direction is not stated.
    """
    if backward is None:
        return forward
    direction = directions[LINEAR_LETTERS.index(str(component.axis))]
    if direction == 0:
        mean: FloatArray = (forward + backward) / 2
        return mean
    return forward if direction > 0 else backward
