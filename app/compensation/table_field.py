"""The volumetric error as a function of position, as compensation tables have it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.compensation.table import CompensationTable, ComponentCompensation
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.thermal.compiled_model import CompiledModel
from app.thermal.thermal_field import (
    MEAN_OF_BOTH,
    Directions,
    by_direction,
    side_by_side,
    thermal_tables,
)


def table_field(
    model: CompiledModel,
    tables: Sequence[CompensationTable],
    directions: Directions = MEAN_OF_BOTH,
) -> ErrorField:
    """Make the error field of one table or of several, adopted effects included.

    Parameters
    ----------
    directions
        Direction of approach of each axis: which of a bidirectional component's tables
        is meant.

    Returns
    -------
    ErrorField
        With an axis of states in its answers if there are several.
    """
    thermal = thermal_tables([table.states for table in tables], directions)
    corrected = {entry.component for table in tables for entry in table.corrected}
    entries = [{e.component: e for e in table.components} for table in tables if corrected]
    for component in corrected:
        of_states = [_table(of_table.get(component), directions) for of_table in entries]
        thermal[component.code] = side_by_side(of_states)
    return ErrorField.make(model.machine.chain, thermal, model.measuring_lines)


def _table(entry: ComponentCompensation | None, directions: Directions) -> Table:
    """Take one direction's table of a component; an absent one is zero."""
    if entry is None:
        return Table(np.empty(0), np.zeros(1))
    values = by_direction(entry.component, entry.errors, entry.backward_errors, directions)
    return Table(entry.positions_mm, values)
