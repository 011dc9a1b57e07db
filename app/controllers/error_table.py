"""A machine's errors at one thermal state, as they go into controllers' files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray, frozen
from app.compensation.table import CompensationTable, ComponentCompensation
from app.controllers.curve import Curve
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, Component, Kind
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.geometry.volumetric_error import NO_TOOL
from app.geometry.work_volume import points_of
from app.thermal.machine import Machine
from app.units import um_from_urad_mm

Range = tuple[float, float]

TRANSLATIONS = tuple(
    code
    for code, component in COMPONENTS.items()
    if component.kind in (Kind.LINEAR, Kind.STRAIGHTNESS)
)
"""Codes of the nine translational errors."""

LINEAR = tuple(code for code, component in COMPONENTS.items() if component.kind is Kind.LINEAR)
"""Codes of the three displacement errors along their own axes."""


@dataclass(frozen=True, slots=True)
class Origin:
    """Where errors come from: what the head of a file says."""

    machine_id: str
    machine_name: str
    model_version: int
    computed_at: datetime
    temperatures_c: Mapping[str, float]
    axes: Sequence[str] = LINEAR_LETTERS


@dataclass(frozen=True, slots=True, eq=False)
class ErrorTable:
    """Every component's curve, how large each is in the work volume, and what is to be said.

    Parameters
    ----------
    curves
        Code to curve, in the order in which tables list components.
    statuses
        Code to how the numbers came about.
    ranges_mm
        Each axis' range [mm]: its travel, or that of its tables.
    sizes_um
        Code to the largest displacement [µm] that the component alone makes in the volume.
    reversals_um
        Code to the largest displacement [µm] in the volume that half of its reversal makes.
    """

    origin: Origin
    curves: Mapping[str, Curve]
    statuses: Mapping[str, str]
    ranges_mm: Mapping[str, Range]
    sizes_um: Mapping[str, float]
    warnings: Sequence[str] = ()
    reversals_um: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        table: CompensationTable,
        machine: Machine,
        errors: ErrorField | None = None,
        tool_offset_mm: ArrayLike = NO_TOOL,
    ) -> ErrorTable:
        """Take a compensation table apart into curves.

        Parameters
        ----------
        errors
            The same errors as a function of position, by which components are sized; where there
            is none nothing is sized.
        tool_offset_mm : array-like, shape (3,) [mm]
            Tool offset at which angular errors are sized.
        """
        components = table.components
        ranges = {a: span for a in machine.chain.axes if (span := _range(machine, components, a))}
        curves = {component.component.code: _curve(component, ranges) for component in components}
        used = {s.sensor: s.temperature_c for s in table.states}
        whose = (machine.id, machine.name, table.model_version, table.computed_at, used)
        return cls(
            origin=Origin(*whose, axes=tuple(machine.chain.axes)),
            curves=curves,
            statuses={
                component.component.code: str(component.basis.status) for component in components
            },
            ranges_mm=ranges,
            sizes_um={
                code: _size_um(curve, errors, ranges, tool_offset_mm)
                for code, curve in curves.items()
                if errors is not None
            },
            warnings=tuple(table.warnings),
            reversals_um={
                code: _size_um(curve.half_reversal(), errors, ranges, tool_offset_mm)
                for code, curve in curves.items()
                if errors is not None and curve.backward_errors is not None
            },
        )

    def folded(self) -> ErrorTable:
        """Add squareness to straightness: EXY gains SXY·y, EXZ SZX·z and EYZ SYZ·z (8.58–8.60).

        Where there is no straightness error, squareness alone makes the curve.
        """
        curves = dict(self.curves)
        statuses = dict(self.statuses)
        for code in [c for c, curve in curves.items() if curve.component.kind is Kind.SQUARENESS]:
            squareness = curves.pop(code)
            folded_from = squareness.component
            target = COMPONENTS[f"E{folded_from.direction}{folded_from.times}".upper()]
            ends = self.ranges_mm.get(str(folded_from.times))
            straightness = curves.get(target.code)
            if straightness is None and ends is None:
                curves[code] = squareness  # no axis, no length: it stays what it is
                continue
            curves[target.code] = _folded(straightness, target, float(squareness.errors[0]), ends)
            statuses.setdefault(target.code, statuses[code])
        ordered = {code: curves[code] for code in COMPONENTS if code in curves}
        return replace(self, curves=ordered, statuses=statuses)


def _range(
    machine: Machine, components: Sequence[ComponentCompensation], axis: str
) -> Range | None:
    travel = machine.axes.get(axis)
    if travel is not None:
        return (travel.min_mm, travel.max_mm)
    tables = [
        component.positions_mm
        for component in components
        if component.component.axis == axis and component.positions_mm.size > 1
    ]
    if not tables:
        return None
    return (float(min(p[0] for p in tables)), float(max(p[-1] for p in tables)))


def _curve(compensation: ComponentCompensation, ranges: Mapping[str, Range]) -> Curve:
    """Make a curve; one that does not depend on position goes from end to end."""
    positions, errors, backward = (
        compensation.positions_mm,
        compensation.errors,
        compensation.backward_errors,
    )
    axis = compensation.component.axis
    if axis is not None and positions.size < 2 and axis in ranges:
        positions = frozen(ranges[axis])
        errors = np.repeat(errors, 2)
        backward = None if backward is None else np.repeat(backward, 2)
    return Curve(compensation.component, positions, errors, backward)


def _folded(
    straightness: Curve | None, target: Component, squareness: float, ends: Range | None
) -> Curve:
    """Add a line [µm/m] to a straightness error, or make a curve of it."""
    if straightness is None:
        assert ends is not None
        at = frozen(ends)
        return Curve(target, at, um_from_urad_mm(squareness) * at)
    at = straightness.positions_mm
    if ends is not None:  # beyond the straightness table squareness goes on to the axis' ends
        at = frozen(np.union1d(at, ends))
    backward = straightness.backward_errors
    line = um_from_urad_mm(squareness) * at
    return Curve(
        target,
        at,
        straightness.at(at) + line,
        None if backward is None else straightness.at(at, "-") + line,
    )


def _size_um(
    curve: Curve, errors: ErrorField, ranges: Mapping[str, Range], tool_offset_mm: ArrayLike
) -> float:
    """Find the largest displacement that one component alone makes in the volume.

    It is linear between the nodes of its own axis and in the other coordinates, so that the
    largest lies at a node and at a corner.
    """
    along: list[FloatArray] = []
    for axis in LINEAR_LETTERS:
        at = np.array(ranges.get(axis, (0.0, 0.0)))
        if axis == curve.component.axis:
            at = np.union1d(at, curve.positions_mm)
        along.append(at)
    largest = 0.0
    for _, values in curve.sides:
        displaced_um, _ = _alone(curve, values, errors).at(points_of(*along), tool_offset_mm)
        largest = max(largest, float(np.linalg.norm(displaced_um, axis=1).max()))
    if curve.component.is_rotation or curve.component.times is not None:
        return largest
    return max(largest, *(float(np.abs(values).max()) for _, values in curve.sides))


def _alone(curve: Curve, values: FloatArray, errors: ErrorField) -> ErrorField:
    """Give the volumetric error of one component in one direction; `errors` has their mean."""
    if not curve.component.is_table:
        return errors.only(lambda component: component.code == curve.code)
    tables = {curve.code: Table(curve.positions_mm, values)}
    return ErrorField.make(errors.chain, tables, errors.measuring_lines)
