"""Measurements: an error map of what one yields, and what an instrument would read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag

from app.answer import fields_of
from app.errors import FieldError, InvalidContent, counted, list_names
from app.field_errors import way_of
from app.geometry.components import LINEAR_LETTERS
from app.geometry.work_volume import WorkVolume
from app.measurement.result import Evaluated, MeasurementResult
from app.measurement.step_diagonal_readings import step_diagonal_readings
from app.rounding import Digits
from app.services.ask_field import AnswerHead, FieldQuestion, Triple, ask_field, work_volume
from app.services.change_model import ModelChange
from app.services.context import Context
from app.services.error_maps import (
    StoredOnce,
    preview_error_map,
    store_error_map,
    table_remarks,
)
from app.services.load_machine import load_machine
from app.services.models import Preview
from app.stated import Integer, Millimetres, Name, Number, Point, Schema, Temperatures, UtcTime
from app.thermal.error_map import ComputedTables, ErrorMap, ShownLines
from app.thermal.machine import Machine, Travel

Repeatability = Annotated[Number, Field(gt=0)]
Axis = Literal["x", "y", "z"]
MOST_POSITIONS: Final = 2000
"""Of one measurement: the covariance of its errors has the square of that."""

Readings = Annotated[list[Number], Field(min_length=1, max_length=MOST_POSITIONS)]
MeasuredPositions = Annotated[list[Millimetres], Field(min_length=1, max_length=MOST_POSITIONS)]


def _one_or_more(value: object) -> str:
    several = isinstance(value, list) and value and isinstance(value[0], list)
    return way_of("more") if several else way_of("one")


Runs = Annotated[
    Annotated[Readings, Tag(way_of("one"))]
    | Annotated[
        Annotated[list[Readings], Field(min_length=1, max_length=1000)], Tag(way_of("more"))
    ],
    Discriminator(_one_or_more),
]
"""One run, or a list of runs, over the positions."""


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


@dataclass(frozen=True, eq=False, kw_only=True)
class MeasurementAnswer(Evaluated, ModelChange):
    """What a measurement yields."""

    machine: Annotated[str, Field(examples=["mcfv5050"])]
    """The machine's id"""
    method: Annotated[str, Field(examples=["step-diagonal"])]
    """How it was measured"""
    label: Annotated[str | None, Field(examples=["Run #1"])]
    """The name of its map, where one was stated"""
    stored: bool
    """Whether an error map was made of it"""
    map_id: Annotated[int | None, Field(examples=[7])]
    """That map's number"""
    is_new: bool
    """False where the same map was there already, or none"""
    tables: Annotated[ComputedTables, Field(alias="components")]
    """The components with their standard errors"""
    figures: Annotated[Mapping[str, Digits], Field(examples=[{"closure_rms_um": 0.31}])]
    """Figures of quality and of the method's standard, by names that end in the unit, such as
    closure_rms_um [µm]"""
    notes: Sequence[str]
    """What the method cannot see, what was left out, what looks wrong"""
    measuring_lines: Annotated[ShownLines, Field(alias="measuring_lines_mm")]
    """Axis to the line along which its translations count as measured [mm]"""
    warnings: Sequence[str] = ()
    """What of its file was not read"""
    preview: Preview | None = None
    """What storing it would do to the tables, where a preview was asked for"""


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
    evaluated: Evaluated,
    storing: Storing,
) -> dict[str, Any]:
    """Store a result as an error map if that is asked for, and give the fields of its answer.

    Raises
    ------
    InvalidContent, Conflict
        As `store_error_map`; InvalidContent also where the map's label, time or
        temperatures are not stated, or the machine lacks the measured axis.
    """
    result, preview, stored = evaluated.result, None, None
    _check_axes(machine, result)
    if not (storing.store or storing.preview):
        remarks: Sequence[str] = table_remarks(machine, result.tables)
    else:
        error_map = map_of_result(machine, method, header, result)
        if storing.preview:
            preview = preview_error_map(context, machine.id, error_map)
            remarks = preview.warnings
        else:
            stored = store_error_map(
                context, machine.id, error_map, accept_losses=storing.accept_losses
            )
            remarks = stored.remarks
    remarks = [*remarks, *evaluated.further_notes]
    return measurement_fields(machine.id, method, header, evaluated, remarks, stored, preview)


def measurement_fields(
    machine_id: str,
    method: str,
    header: MeasurementRequest,
    evaluated: Evaluated,
    remarks: Sequence[str],
    stored: StoredOnce | None,
    preview: Preview | None,
) -> dict[str, Any]:
    """Give the fields of `MeasurementAnswer`."""
    result = evaluated.result
    change = stored.made.change if stored is not None and stored.made else ModelChange()
    if preview is not None:
        change = ModelChange(activated=preview.activated, loses=preview.loses, gains=preview.gains)
    return {
        **fields_of(change),
        **{name: getattr(evaluated, name) for name in ("result", "further_notes")},
        "machine": machine_id,
        "method": method,
        "label": header.label,
        "stored": stored is not None,
        "map_id": None if stored is None else stored.stored.id,
        "is_new": stored is not None and stored.is_new,
        "tables": result.tables,
        "figures": result.figures,
        "notes": [*result.notes, *remarks],
        "measuring_lines": result.measuring_lines,
        "preview": preview,
    }


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


class StepDiagonalSimulation(
    FieldQuestion,
    example={
        "temperatures_c": {"x-middle": 24.1, "z-column": 27.3},
        "steps": 10,
        "noise_um": 0.2,
        "missing_components": "zero",
    },
):
    """A step diagonal that is planned, at stated temperatures or at the latest reading."""

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
