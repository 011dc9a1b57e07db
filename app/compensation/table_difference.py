"""By how much each component of one compensation table differs from another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from app.answer import Answer, Code, UnitSymbol
from app.arrays import FloatArray
from app.compensation.table import CompensationTable, ComponentCompensation


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentChange(Answer, published_as="ComponentChangeAnswer", whole=False):
    """The largest change of one component's error."""

    component: Code
    """Component code"""
    chapter: Annotated[str, Field(examples=["D_x(x)"])]
    """The chapter's notation"""
    change: float
    """Error afterwards minus error before, in `unit`"""
    unit: UnitSymbol
    """Unit of the change"""
    position_mm: float | None = None
    """Where [mm]; null without positions"""
    direction: Literal["+", "-"]
    """Direction of approach in which it is so"""
    status_before: Annotated[str, Field(examples=["clamped"])]
    """How it comes about now"""
    status_after: Annotated[str, Field(examples=["at-map"])]
    """How it would come about"""


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
        component=after.component.code,
        chapter=after.component.chapter,
        change=float(sides[side][at]),
        unit=after.component.unit.symbol,
        position_mm=float(positions[at]) if positions.size else None,
        direction="-" if side else "+",
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
