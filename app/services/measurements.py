"""Measurements: an error map of what one yields, and what an instrument would read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import ConfigDict, Field

from app.errors import FieldError, InvalidContent, counted, list_names
from app.geometry.components import LINEAR_LETTERS
from app.geometry.work_volume import WorkVolume
from app.measurement.result import MeasurementResult
from app.measurement.step_diagonal_readings import step_diagonal_readings
from app.rounding import Digits
from app.services.ask_field import AnswerHead, FieldQuestion, Triple, ask_field, work_volume
from app.services.context import Context
from app.services.error_maps import (
    StoredOnce,
    preview_error_map,
    store_error_map,
    table_remarks,
)
from app.services.load_machine import load_machine
from app.services.models import Preview
from app.stated import Integer, Name, Number, Point, Schema, Temperatures, UtcTime
from app.thermal.error_map import ErrorMap
from app.thermal.machine import Machine, Travel

Repeatability = Annotated[Number, Field(gt=0)]


class MeasurementRequest(Schema):
    """What makes an error map of a measurement; needed only where it is to be stored."""

    label: Name | None = Field(None, description="The map's name", examples=["Run #1"])
    measured_at: UtcTime | None = Field(
        None, description="When it was measured, with a zone", examples=["2026-03-01T06:00:00Z"]
    )
    temperatures_c: Temperatures | None = Field(
        None, description="Every sensor's temperature at that time [°C]"
    )
    instrument: Name | None = Field(None, description="What measured", examples=["laser vector"])
    repeatability_um: Repeatability | None = Field(
        None,
        description="Standard deviation of one reading, where the readings do not show it [µm]",
        examples=[0.3],
    )


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A measurement's result, and the map that was made of it, or what storing it would do."""

    machine: Machine
    method: str
    result: MeasurementResult
    stored: StoredOnce | None
    remarks: Sequence[str]
    preview: Preview | None = None


@dataclass(frozen=True, slots=True)
class Storing:
    """What is to become of a result: nothing, a look at what storing would do, or a map.

    A preview stores nothing, whatever else is stated. `course` is whether that of a test of hours
    becomes a verification.
    """

    store: bool = False
    preview: bool = False
    accept_losses: bool = False
    course: bool = False


def measured_machine(context: Context, machine_id: str) -> Machine:
    """Describe the machine that is measured."""
    live = context.live.get(machine_id) or load_machine(context, machine_id)
    return live.current.model.machine


def store_measurement(
    context: Context,
    machine: Machine,
    method: str,
    header: MeasurementRequest,
    result: MeasurementResult,
    storing: Storing,
) -> Measured:
    """Hand a result on, and store it as an error map if that is asked for.

    Raises
    ------
    InvalidContent, Conflict
        As `store_error_map`; InvalidContent also where the map's label, time or
        temperatures are not stated, or the machine lacks the measured axis.
    """
    _check_axes(machine, result)
    if not (storing.store or storing.preview):
        return Measured(machine, method, result, None, table_remarks(machine, result.tables))
    error_map = map_of_result(machine, method, header, result)
    if storing.preview:
        preview = preview_error_map(context, machine.id, error_map)
        return Measured(machine, method, result, None, preview.warnings, preview)
    stored = store_error_map(context, machine.id, error_map, accept_losses=storing.accept_losses)
    return Measured(stored.machine, method, result, stored, stored.remarks)


def _check_axes(machine: Machine, result: MeasurementResult) -> None:
    for table in result.tables:
        axis = table.component.axis
        if axis is not None and axis not in machine.chain.axes:
            raise InvalidContent.of_field(
                "axis", f"expected an axis of {machine.chain.text}, got {axis!r}"
            )


def map_of_result(
    machine: Machine, method: str, header: MeasurementRequest, result: MeasurementResult
) -> ErrorMap:
    """Make the error map of a measurement's result.

    Raises
    ------
    InvalidContent
        If label, time or temperatures are not stated, or the machine lacks the measured axis.
    """
    _check_axes(machine, result)
    label, measured_at, temperatures_c = header.label, header.measured_at, header.temperatures_c
    if label is None or measured_at is None or not temperatures_c:
        fields = {"label": label, "measured_at": measured_at, "temperatures_c": temperatures_c}
        lacking = [name for name, value in fields.items() if not value]
        message = f"expected {list_names(lacking)} for the map that is to be stored, got none"
        raise InvalidContent(message, [FieldError(name, message) for name in lacking])
    return ErrorMap(
        label=label,
        measured_at=measured_at,
        temperatures_c=temperatures_c,
        tables={table.component.code: table for table in result.tables},
        measuring_lines=result.measuring_lines,
        repeatability_um=header.repeatability_um,
        # A map says at least by which method it was made.
        instrument=header.instrument or method,
    )


def travel_volume(machine: Machine, stated: Mapping[str, Travel]) -> WorkVolume | None:
    """Choose a box: what is stated, else the axes' travel; None where an axis has neither.

    Raises
    ------
    InvalidContent
        If a stated range is of no axis, or no range.
    """
    unknown = [axis for axis in stated if axis not in LINEAR_LETTERS]
    if unknown:
        raise InvalidContent.of_field(
            f"volume.{unknown[0]}", f"expected axes x, y and z, got {list_names(unknown)}"
        )
    travels = [stated.get(axis) or machine.axes.get(axis) for axis in LINEAR_LETTERS]
    if any(travel is None for travel in travels):
        return None
    x, y, z = ((t.min_mm, t.max_mm) for t in travels if t is not None)
    return WorkVolume(x, y, z)


MOST_STEPS: Final = 1000

Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
NotNegative = Annotated[Number, Field(ge=0, le=1e4)]


class StepDiagonalSimulation(FieldQuestion):
    """A step diagonal that is planned, at stated temperatures or at the latest reading."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "temperatures_c": {"x-middle": 24.1, "z-column": 27.3},
                "steps": 10,
                "noise_um": 0.2,
                "missing_components": "zero",
            }
        }
    )

    steps: Annotated[Integer, Field(ge=1, le=MOST_STEPS)] = Field(
        description="Number of steps of each axis", examples=[10]
    )
    origin_mm: Point | None = Field(
        None, description="Lowest corner of the volume; the travel's if left out [mm]"
    )
    step_mm: Point | None = Field(
        None, description="Length of a step of x, y, z; over the whole travel if left out [mm]"
    )
    target: Literal["point", "flat-mirror"] = Field("point", description="What reflects")
    mirror_tilts_urad: dict[str, Pair] = Field(
        default_factory=dict,
        description="Diagonal to its mirror's two tilts: about the horizontal and the other "
        "direction beside the diagonal [µrad]",
    )
    noise_um: NotNegative = Field(0.0, description="Standard deviation of one reading [µm]")
    resolution_um: NotNegative | None = Field(
        None, description="Readings are rounded to multiples of this [µm]"
    )
    seed: Annotated[Integer, Field(ge=0)] = Field(
        0, description="Of the noise: the same seed gives the same readings"
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulatedStepDiagonal(AnswerHead):
    """What a laser would read: the body of `…/measurements/step-diagonal`, and what it is of."""

    origin_mm: Sequence[float]
    """Lowest corner of the volume [mm]"""
    step_mm: Sequence[float]
    """Length of a step of x, y, z [mm]"""
    tool_offset_mm: Sequence[float]
    """Tool offset of the target's middle [mm]"""
    target: str
    """What reflects"""
    temperatures_c: Mapping[str, float]
    """Temperatures that were used [°C]"""
    diagonals: Mapping[str, Sequence[Sequence[Digits]]]
    """Diagonal to a row for each step: after x, after y, after z [µm]"""


def simulate_step_diagonal(
    context: Context, machine_id: str, plan: StepDiagonalSimulation
) -> SimulatedStepDiagonal:
    """Walk the stored machine along its diagonals, and say what a laser would read.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field`; InvalidContent also if the steps leave the axes' travel.
    """
    answer = ask_field(context, machine_id, plan, orientation=False)
    volume, remarks = work_volume(answer)
    origin, step = _placed(plan, volume.ranges_mm)
    for i, (low, high) in enumerate(volume.ranges_mm):
        end = origin[i] + plan.steps * step[i]
        if step[i] <= 0 or origin[i] < low - 1e-9 or end > high + 1e-9:
            raise InvalidContent.of_field(
                "step_mm",
                f"expected {counted(plan.steps, 'step')} above 0 mm inside {'xyz'[i]} "
                f"{low:g} to {high:g} mm, got steps of {step[i]:g} mm from {origin[i]:g} to "
                f"{end:g} mm",
            )
    diagonals = step_diagonal_readings(
        answer.field,
        origin,
        step,
        plan.steps,
        tool_offset_mm=plan.tool_offset_mm,
        target=plan.target,
        mirror_tilts_urad=plan.mirror_tilts_urad,
        noise_um=plan.noise_um,
        rng=np.random.default_rng(plan.seed),
        resolution_um=plan.resolution_um or None,
    )
    return SimulatedStepDiagonal(
        **answer.head(remarks),
        origin_mm=origin,
        step_mm=step,
        tool_offset_mm=plan.tool_offset_mm,
        target=plan.target,
        temperatures_c=answer.temperatures_c[0],
        diagonals={name: rows.tolist() for name, rows in diagonals.items()},
    )


def _placed(
    plan: StepDiagonalSimulation, ranges_mm: Sequence[tuple[float, float]]
) -> tuple[Triple, Triple]:
    """Place the steps: as planned, or over the whole travel."""
    x, y, z = plan.origin_mm or tuple(low for low, _ in ranges_mm)
    origin = (x, y, z)
    spans = [(high - o) / plan.steps for o, (_, high) in zip(origin, ranges_mm, strict=True)]
    a, b, c = plan.step_mm or tuple(spans)
    return origin, (a, b, c)
