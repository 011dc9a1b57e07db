"""By how much each component of one compensation table differs from another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.arrays import FloatArray
from app.compensation.table import CompensationTable, ComponentCompensation
from app.geometry.components import Component


@dataclass(frozen=True, slots=True)
class ComponentChange:
    """The largest change of one component's error from one table to the next.

    `change` is signed, in the component's unit; `position_mm` says where, None for a component
    without positions, and `is_backward` in which direction of approach. The statuses say how
    both came about.
    """

    component: Component
    change: float
    position_mm: float | None
    is_backward: bool
    status_before: str
    status_after: str


def component_changes(before: CompensationTable, after: CompensationTable) -> list[ComponentChange]:
    """Compare the components that both tables have, over the positions that both cover.

    Returns
    -------
    list of ComponentChange
        The largest number first, whatever its unit: a µrad is a µm at an arm of one metre.
    """
    earlier = {entry.component.code: entry for entry in before.components}
    changes = [
        change
        for entry in after.components
        if entry.component.code in earlier
        and (change := _change(earlier[entry.component.code], entry)) is not None
    ]
    return sorted(changes, key=lambda listed: -abs(listed.change))


def _change(before: ComponentCompensation, after: ComponentCompensation) -> ComponentChange | None:
    positions = _common(before.positions_mm, after.positions_mm)
    if after.component.is_table and not positions.size:
        return None
    sides = [
        after.errors_at(positions, is_backward=b) - before.errors_at(positions, is_backward=b)
        for b in (False, True)
    ]
    side = int(np.abs(sides[1]).max() > np.abs(sides[0]).max())
    at = int(np.abs(sides[side]).argmax())
    return ComponentChange(
        component=after.component,
        change=float(sides[side][at]),
        position_mm=float(positions[at]) if positions.size else None,
        is_backward=bool(side),
        status_before=str(before.basis.status),
        status_after=str(after.basis.status),
    )


def _common(first: FloatArray, other: FloatArray) -> FloatArray:
    """Unite two tables' positions inside the range of both; one position limits nothing."""
    union = np.union1d(first, other)
    ranges = [positions for positions in (first, other) if positions.size > 1]
    if not ranges:
        return union
    low, high = max(p[0] for p in ranges), min(p[-1] for p in ranges)
    common: FloatArray = union[(union >= low) & (union <= high)]
    return common
