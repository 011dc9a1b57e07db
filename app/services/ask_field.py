"""A machine's error field at stated temperatures or at the latest reading, and its work volume."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Any

from pydantic import Field

from app.answer import Answer
from app.compensation.table import CompensationTable
from app.compensation.table_field import table_field
from app.effects.kinds.backlash import Backlash
from app.errors import (
    FieldError,
    InvalidContent,
    StorageUnavailable,
    UnknownThing,
    list_names,
)
from app.geometry.components import LINEAR_LETTERS
from app.geometry.error_field import ErrorField
from app.geometry.needed_components import needed_components
from app.geometry.work_volume import Range, WorkVolume
from app.live.registry import LiveMachine
from app.services.context import Context
from app.services.live_table import current_state, current_table, database_warnings, table_at
from app.services.load_machine import lacks_reading, load_machine, restore_past
from app.stated import (
    Direction,
    MachineState,
    MissingComponents,
    Point,
    Schema,
    Temperatures,
    signs_of,
)
from app.thermal.compiled_model import CompiledModel
from app.thermal.machine import Machine, Travel
from app.thermal.thermal_field import MEAN_OF_BOTH, Directions

Triple = tuple[float, float, float]


class TableQuestion(Schema):
    """At which temperatures a machine's errors are asked, what is missing counting as zero.

    The stated `state` takes precedence over what the latest reading says.
    """

    temperatures_c: Temperatures | None = Field(
        None, description="Temperatures by sensor [°C]; those of the latest reading if left out"
    )
    state: MachineState = Field(default_factory=dict)
    tool_offset_mm: Point = Field(
        (0.0, 0.0, 0.0), description="Tool offset X, Y, Z [mm]", examples=[[0, 0, 160]]
    )

    @property
    def thermal_states(self) -> Sequence[Mapping[str, float]] | None:
        """The temperatures of each thermal state; None for the latest reading."""
        return None if self.temperatures_c is None else [self.temperatures_c]

    @property
    def directions(self) -> Directions:
        """Direction of approach of each axis."""
        return MEAN_OF_BOTH

    @property
    def missing_as_zero(self) -> bool:
        """Whether components that no two maps have may count as zero."""
        return True


class FieldQuestion(TableQuestion):
    """At which temperatures the machine's errors are asked, and under which conditions."""

    direction: Direction = Field(
        None,
        description="Direction of approach, of all axes or of each; the mean of both where it is "
        "not stated",
        examples=[{"x": "+", "y": "-"}],
    )
    missing_components: MissingComponents

    @property
    def directions(self) -> Directions:
        """Direction of approach of each axis."""
        return signs_of(self.direction)

    @property
    def missing_as_zero(self) -> bool:
        """Whether components that no two maps have may count as zero."""
        return self.missing_components == "zero"


Volume = Annotated[
    dict[str, Travel],
    Field(
        default_factory=dict,
        description="Range of each axis [mm]; its travel where it is left out",
        examples=[{"x": {"min_mm": 100, "max_mm": 400}}],
    ),
]


class VolumeQuestion(FieldQuestion):
    """The same over a work volume."""

    volume: Volume


@dataclass(frozen=True, kw_only=True)
class AnswerHead(Answer):
    """What every answer about the machine in three dimensions says of itself."""

    machine: Annotated[str, Field(examples=["mcfv5050"])]
    """The machine's id"""
    model_version: Annotated[int, Field(examples=[3])]
    """Version of the model"""
    computed_at: datetime
    """When it was computed, UTC"""
    complete: bool
    """Whether no component and no adopted effect is missing, none rests on an old temperature or on
    a reading that arrived before its time, or ends where other maps of it go on"""
    warnings: Sequence[str]
    """All that is not as it should be, in sentences"""
    counted_as_zero: Annotated[Sequence[str], Field(examples=[["ECZ"]])]
    """Components that no two maps have and that count as zero"""


@dataclass(frozen=True, slots=True, eq=False)
class FieldAnswer:
    """A field, and everything a user must know of it.

    `counted_as_zero` are the components without maps that the volumetric error would
    consist of; `tables` are the compensation tables that the field was made of.
    """

    model: CompiledModel
    field: ErrorField
    tables: Sequence[CompensationTable]
    temperatures_c: Sequence[Mapping[str, float]]
    counted_as_zero: Sequence[str]
    warnings: Sequence[str]

    @property
    def machine(self) -> Machine:
        """Whose field it is."""
        return self.model.machine

    @property
    def model_version(self) -> int:
        """The model's number."""
        return self.tables[0].model_version

    @property
    def computed_at(self) -> datetime:
        """When it was computed."""
        return self.tables[0].computed_at

    @property
    def complete(self) -> bool:
        """Whether nothing counts as zero, and every table is complete."""
        return not self.counted_as_zero and all(table.complete for table in self.tables)

    def head(self, remarks: Sequence[str] = ()) -> dict[str, Any]:
        """Give the fields of `AnswerHead`; remarks come after its warnings."""
        return {
            "machine": self.machine.id,
            "model_version": self.model_version,
            "computed_at": self.computed_at,
            "complete": self.complete,
            "warnings": [*self.warnings, *remarks],
            "counted_as_zero": self.counted_as_zero,
        }


def ask_field(
    context: Context,
    machine_id: str,
    question: TableQuestion,
    *,
    orientation: bool = True,
    needed: Sequence[str] | None = None,
) -> FieldAnswer:
    """Make a machine's error field.

    Parameters
    ----------
    orientation
        Whether the tool's direction is asked for beside its position.
    needed
        Codes of the components that the answer needs; where nothing is stated those
        of the volumetric error.

    Raises
    ------
    NoReading
        If the latest reading is asked for and there is none that can be used.
    InvalidContent
        As `table_at`; or if a component is needed that no two maps have.
    """
    live = context.live.get(machine_id) or load_machine(context, machine_id)
    model = live.current.model
    tables = _tables(context, machine_id, live, question)
    have = {code for group in model.groups for code in group.codes}
    have |= {entry.component.code for table in tables for entry in table.corrected}
    if needed is None:
        needed = needed_components(
            model.machine.chain,
            question.tool_offset_mm,
            model.measuring_lines,
            orientation=orientation,
        )
    missing = [code for code in needed if code not in have]
    if missing and not question.missing_as_zero:
        raise missing_refused(model, missing)
    return FieldAnswer(
        model=model,
        field=table_field(model, tables, question.directions),
        tables=tables,
        temperatures_c=[{s.sensor: s.temperature_c for s in t.states} for t in tables],
        counted_as_zero=missing,
        warnings=[
            *dict.fromkeys(w for table in tables for w in table.warnings),
            *_without_direction(tables, question.directions),
        ],
    )


def work_volume(
    answer: FieldAnswer, travels: Mapping[str, Travel] | None = None
) -> tuple[WorkVolume, list[str]]:
    """Choose the work volume: what is stated, else the axes' travel, else the tables' range.

    Returns
    -------
    volume : WorkVolume
        Along an axis that the machine does not have, 0 to 0.
    remarks
        In sentences, where the tables' range had to serve.

    Raises
    ------
    InvalidContent
        If a stated range is no range, of no axis, or outside the axis' travel, or if
        nothing says how far an axis goes.
    """
    machine = answer.machine
    remarks: list[str] = []
    ranges: dict[str, Range] = dict.fromkeys(LINEAR_LETTERS, (0.0, 0.0))
    for axis in travels or {}:
        if axis not in machine.chain.axes:
            raise InvalidContent.of_field(
                f"volume.{axis}",
                f"expected the axes of {machine.chain.text}, got {axis!r}",
            )
    for axis in machine.chain.axes:
        chosen = (travels or {}).get(axis) or machine.axes.get(axis)
        if chosen is None:
            chosen = _range_of_tables(answer, axis)
            remarks.append(
                f"the machine states no travel of {axis}: the tables' range of "
                f"{chosen.min_mm:g} to {chosen.max_mm:g} mm serves"
            )
        check_travel(machine, axis, (chosen.min_mm, chosen.max_mm), f"volume.{axis}")
        if not chosen.min_mm < chosen.max_mm:
            raise InvalidContent.of_field(
                f"volume.{axis}",
                f"expected min_mm below max_mm, got {chosen.min_mm:g} and {chosen.max_mm:g} mm",
            )
        ranges[axis] = (chosen.min_mm, chosen.max_mm)
    return WorkVolume(ranges["x"], ranges["y"], ranges["z"]), remarks


def volume_of(volume: WorkVolume) -> dict[str, Travel]:
    """Give the range of each axis that the machine has."""
    return {
        axis: Travel(low, high)
        for axis, (low, high) in zip(LINEAR_LETTERS, volume.ranges_mm, strict=True)
        if low < high
    }


def check_travel(machine: Machine, axis: str, range_mm: Range, field: str) -> None:
    """Refuse a range of positions that leaves an axis' stated travel."""
    travel = machine.axes.get(axis)
    if travel and not travel.holds(*range_mm):
        raise InvalidContent.of_field(
            field,
            f"expected {axis} within the axis' travel of {travel.min_mm:g} to "
            f"{travel.max_mm:g} mm, got {range_mm[0]:g} to {range_mm[1]:g} mm",
        )


def _tables(
    context: Context,
    machine_id: str,
    live: LiveMachine,
    question: TableQuestion,
) -> list[CompensationTable]:
    temperatures_c, state = question.thermal_states, question.state
    if temperatures_c is None:
        if lacks_reading(context, live):
            with suppress(StorageUnavailable, UnknownThing):
                restore_past(context, live)
        now = current_state(context, machine_id, live, state)
        return [current_table(context, now).table]
    warnings = database_warnings(context, live.current)
    tables = []
    for i, temperatures in enumerate(temperatures_c):
        try:
            tables.append(table_at(live.current, temperatures, context.now(), warnings, state))
        except InvalidContent as error:
            if len(temperatures_c) == 1:
                raise
            fields = [
                FieldError(e.field.replace("temperatures_c", f"temperatures_c.{i}", 1), e.message)
                for e in error.errors
            ]
            raise type(error)(f"thermal state {i}: {error.detail}", fields) from None
    return tables


def _without_direction(tables: Sequence[CompensationTable], directions: Directions) -> list[str]:
    """Say which adopted reversals do not show, because nobody said from where the axis comes."""
    reversing = [
        entry.component.code
        for entry in tables[0].corrected
        if Backlash.kind in entry.effects
        and directions[LINEAR_LETTERS.index(str(entry.component.axis))] == 0
    ]
    if not reversing:
        return []
    return [f"the reversal of {list_names(reversing)} is left out: no direction is stated"]


def missing_refused(model: CompiledModel, missing: Sequence[str]) -> InvalidContent:
    """Make the refusal: which components are missing, and how to say that they are zero."""
    unmeasured = [code for code in missing if code not in model.omitted]
    reasons = [f"{code}: {model.omitted[code]}" for code in missing if code in model.omitted]
    if unmeasured:
        reasons.insert(0, f"no map has {list_names(unmeasured)}")
    return InvalidContent.of_field(
        "missing_components",
        f"expected each error that is needed in at least two maps and with a sensor, got too "
        f"little ({'; '.join(reasons)}); state 'zero' where these may count as zero",
    )


def _range_of_tables(answer: FieldAnswer, axis: str) -> Travel:
    nodes = answer.field.nodes_mm(axis)
    if not nodes.size:
        raise InvalidContent.of_field(
            f"volume.{axis}",
            f"expected a range of {axis} in mm: neither the machine's travel nor a table says how "
            "far the axis goes",
        )
    return Travel(float(nodes[0]), float(nodes[-1]))
