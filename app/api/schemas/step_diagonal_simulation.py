"""Simulated readings over HTTP."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, Self

from pydantic import ConfigDict, Field

from app.api.schemas.base import Integer, Number, Point
from app.api.schemas.error_field import AnswerHead, FieldRequest, head_of, triple
from app.rounding import Digits

if TYPE_CHECKING:
    from app.services.measurements import SimulatedReadings, StepDiagonalPlan

MOST_STEPS: Final = 1000

Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
NotNegative = Annotated[Number, Field(ge=0, le=1e4)]


class StepDiagonalSimulation(FieldRequest):
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

    def plan(self) -> StepDiagonalPlan:
        """Make the plan."""
        from app.services.measurements import StepDiagonalPlan

        return StepDiagonalPlan(
            steps=self.steps,
            origin_mm=None if self.origin_mm is None else triple(self.origin_mm),
            step_mm=None if self.step_mm is None else triple(self.step_mm),
            target=self.target,
            mirror_tilts_urad=self.mirror_tilts_urad,
            noise_um=self.noise_um,
            resolution_um=self.resolution_um or None,
            seed=self.seed,
        )


class SimulatedStepDiagonal(AnswerHead):
    """What a laser would read: the body of `…/measurements/step-diagonal`, and what it is of."""

    origin_mm: list[Number] = Field(description="Lowest corner of the volume [mm]")
    step_mm: list[Number] = Field(description="Length of a step of x, y, z [mm]")
    tool_offset_mm: list[Number] = Field(description="Tool offset of the target's middle [mm]")
    target: str = Field(description="What reflects")
    temperatures_c: dict[str, Number] = Field(description="Temperatures that were used [°C]")
    diagonals: dict[str, list[list[Digits]]] = Field(
        description="Diagonal to a row for each step: after x, after y, after z [µm]"
    )

    @classmethod
    def of(cls, body: StepDiagonalSimulation, simulated: SimulatedReadings) -> Self:
        """Show what would be read."""
        fields: dict[str, Any] = head_of(simulated.answer, simulated.warnings)
        return cls(
            **fields,
            origin_mm=list(simulated.origin_mm),
            step_mm=list(simulated.step_mm),
            tool_offset_mm=list(body.tool_offset_mm),
            target=body.target,
            temperatures_c=dict(simulated.answer.temperatures_c[0]),
            diagonals={name: rows.tolist() for name, rows in simulated.diagonals.items()},
        )
