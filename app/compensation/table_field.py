"""The volumetric error as a function of position, as compensation tables have it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.arrays import FloatArray
from app.compensation.table import CompensationTable, ComponentCompensation
from app.geometry.components import Component
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.thermal.compiled_model import CompiledModel
from app.thermal.thermal_field import MEAN_OF_BOTH, Directions, by_direction, thermal_tables


def table_field(
    model: CompiledModel,
    tables: Sequence[CompensationTable],
    directions: Directions = MEAN_OF_BOTH,
) -> ErrorField:
    """Make the error field of one table or of several, adopted effects included.

    Parameters
    ----------
    model
        The compiled model.
    tables
        One for each thermal state.
    directions
        Direction of approach of each axis: which of a bidirectional component's tables
        is meant.

    Returns
    -------
    ErrorField
        With an axis of states in its answers if there are several.
    """
    found = thermal_tables(model, [table.states for table in tables], directions)
    corrected = {entry.component for table in tables for entry in table.corrected}
    entries = [{e.component: e for e in table.components} for table in tables if corrected]
    for component in corrected:
        of_tables = [by_component.get(component) for by_component in entries]
        found[component.code] = _side_by_side(component, of_tables, directions)
    return ErrorField.make(model.machine.chain, found, model.measuring_lines)


def _side_by_side(
    component: Component, entries: Sequence[ComponentCompensation | None], directions: Directions
) -> Table:
    """Bring one component of several tables to common positions; absent ones are zero."""
    positions = np.unique(np.concatenate([e.positions_mm for e in entries if e is not None]))
    rows = [
        np.zeros(max(positions.size, 1)) if e is None else _on(positions, e, directions)
        for e in entries
    ]
    return Table(positions, rows[0] if len(rows) == 1 else np.array(rows))


def _on(
    positions_mm: FloatArray, entry: ComponentCompensation, directions: Directions
) -> FloatArray:
    values = by_direction(entry.component, entry.errors, entry.backward_errors, directions)
    if entry.positions_mm.size < 2:
        return np.broadcast_to(values, (max(positions_mm.size, 1),))
    return np.interp(positions_mm, entry.positions_mm, values)
