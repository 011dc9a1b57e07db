"""What all questions about the machine in three dimensions share over HTTP."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from app.api.schemas.base import (
    Direction,
    MachineState,
    MissingComponents,
    Point,
    Schema,
    Temperatures,
    UtcTime,
    signs_of,
)
from app.api.schemas.machines import TravelSchema
from app.thermal.machine import Travel

if TYPE_CHECKING:
    from app.services.ask_field import FieldAnswer, FieldQuestion, Triple

Volume = Annotated[
    dict[str, TravelSchema],
    Field(
        default_factory=dict,
        description="Range of each axis [mm]; its travel where it is left out",
        examples=[{"x": {"min_mm": 100, "max_mm": 400}}],
    ),
]


class FieldRequest(Schema):
    """At which temperatures the machine's errors are asked, and under which conditions."""

    temperatures_c: Temperatures | None = Field(
        None, description="Temperatures by sensor [°C]; those of the latest reading if left out"
    )
    state: MachineState
    tool_offset_mm: Point = Field(
        [0.0, 0.0, 0.0], description="Tool offset X, Y, Z [mm]", examples=[[0, 0, 160]]
    )
    direction: Direction = Field(
        None,
        description="Direction of approach, of all axes or of each; the mean of both where it is "
        "not stated",
        examples=[{"x": "+", "y": "-"}],
    )
    missing_components: MissingComponents

    def question(self) -> FieldQuestion:
        """Make the question."""
        from app.services.ask_field import FieldQuestion

        given_c = self.temperatures_c
        return FieldQuestion(
            temperatures_c=None if given_c is None else [given_c],
            tool_offset_mm=triple(self.tool_offset_mm),
            directions=signs_of(self.direction),
            missing_as_zero=self.missing_components == "zero",
            state=self.state,
        )


class VolumeRequest(FieldRequest):
    """The same over a work volume."""

    volume: Volume

    def travels(self) -> dict[str, Travel]:
        """Give the stated range of each axis."""
        return {axis: Travel(t.min_mm, t.max_mm) for axis, t in self.volume.items()}


class AnswerHead(Schema):
    """What every answer about the machine in three dimensions says of itself."""

    machine: str = Field(description="The machine's id", examples=["mcfv5050"])
    model_version: int = Field(description="Version of the model", examples=[3])
    computed_at: UtcTime = Field(description="When it was computed, UTC")
    complete: bool = Field(
        description="Whether no component and no adopted effect is missing, none rests on an "
        "old temperature or on a reading that arrived before its time, or ends where other maps "
        "of it go on"
    )
    warnings: list[str] = Field(description="All that is not as it should be, in sentences")
    counted_as_zero: list[str] = Field(
        description="Components that no two maps have and that count as zero", examples=[["ECZ"]]
    )


def head_of(answer: FieldAnswer, warnings: list[str]) -> dict[str, Any]:
    """Write the fields of `AnswerHead`."""
    return {
        "machine": answer.machine.id,
        "model_version": answer.model_version,
        "computed_at": answer.computed_at,
        "complete": answer.complete,
        "warnings": warnings,
        "counted_as_zero": list(answer.counted_as_zero),
    }


def triple(point: list[float]) -> Triple:
    """Take three coordinates as they are."""
    x, y, z = point
    return (x, y, z)
