"""Positioning by ISO 230-2, and six errors of an axis at once, over HTTP."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from pydantic import ConfigDict, Field

from app.api.schemas.base import Number, Point, Schema
from app.api.schemas.measurements.base import (
    Axis,
    MeasuredPositions,
    MeasurementAnswer,
    MeasurementRequest,
    Repeatability,
    Runs,
)
from app.rounding import Digits, Micro

if TYPE_CHECKING:
    from app.measurement.positioning import Positioning


class PositioningRequest(MeasurementRequest):
    """Runs over target positions in both directions."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "axis": "x",
                "targets_mm": [0, 250, 500],
                "forward_um": [[0.0, 1.2, 2.0], [0.2, 1.0, 2.3]],
                "backward_um": [[-1.1, 0.3, 1.2], [-0.9, 0.1, 1.1]],
            }
        }
    )

    axis: Axis = Field(description="The axis that was measured")
    targets_mm: MeasuredPositions = Field(description="Target positions [mm]")
    forward_um: Runs = Field(
        description="Runs in the positive direction, each with measured minus target position "
        "at every target [µm]"
    )
    backward_um: Runs | None = Field(None, description="The same in the negative direction [µm]")


class TargetAnswer(Schema):
    """ISO 230-2's values at one target position."""

    target_mm: Number = Field(description="Target position [mm]")
    mean_forward_um: Micro = Field(description="Mean deviation x̄↑ [µm]")
    mean_backward_um: Micro | None = Field(description="Mean deviation x̄↓ [µm]")
    mean_um: Micro = Field(description="Mean of both, x̄ [µm]")
    reversal_um: Micro | None = Field(description="Reversal value B, x̄↑ less x̄↓ [µm]")
    standard_deviation_forward_um: Digits | None = Field(description="s↑ [µm]")
    standard_deviation_backward_um: Digits | None = Field(description="s↓ [µm]")
    repeatability_forward_um: Digits | None = Field(description="R↑ = 4 s↑ [µm]")
    repeatability_backward_um: Digits | None = Field(description="R↓ = 4 s↓ [µm]")
    repeatability_um: Digits | None = Field(description="Bidirectional repeatability R [µm]")


class PositioningAnswer(MeasurementAnswer):
    """ISO 230-2's figures of the axis (A, E, M, B, R in `figures`) and its displacement error."""

    targets: list[TargetAnswer] = Field(description="The values at each target position")

    @classmethod
    def targets_of(cls, positioning: Positioning) -> list[TargetAnswer]:
        """Show the values at each target."""
        forward, backward = positioning.forward, positioning.backward
        columns = {
            "target_mm": positioning.targets_mm,
            "mean_forward_um": forward.mean,
            "mean_backward_um": None if backward is None else backward.mean,
            "mean_um": positioning.mean_um,
            "reversal_um": positioning.reversal_um,
            "standard_deviation_forward_um": forward.standard_deviation,
            "standard_deviation_backward_um": (
                None if backward is None else backward.standard_deviation
            ),
            "repeatability_forward_um": forward.repeatability,
            "repeatability_backward_um": None if backward is None else backward.repeatability,
            "repeatability_um": positioning.bidirectional_repeatability_um,
        }
        return [
            TargetAnswer.model_validate(
                {name: None if values is None else values[i] for name, values in columns.items()}
            )
            for i in range(positioning.targets_mm.size)
        ]


class SixDofRequest(MeasurementRequest):
    """Up to six errors of one axis, read together."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "axis": "x",
                "positions_mm": [0, 250, 500],
                "linear_um": [0, 1.4, 2.9],
                "straightness_um": {"y": [0, 0.6, 0.1], "z": [0, -0.4, 0.3]},
                "angular_urad": {"a": [0, 2, 5], "b": [0, 8, 15], "c": [0, -3, -4]},
                "measuring_line_mm": [0, 250, 100],
            }
        }
    )

    axis: Axis = Field(description="The axis that was measured")
    positions_mm: MeasuredPositions = Field(description="Positions on the axis [mm]")
    linear_um: Runs | None = Field(None, description="Displacement error, one run or several [µm]")
    straightness_um: dict[str, Runs] = Field(
        default_factory=dict, description="Straightness errors in the other directions [µm]"
    )
    angular_urad: dict[str, Runs] = Field(
        default_factory=dict, description="Angular errors about X (a), Y (b), Z (c) [µrad]"
    )
    backward_linear_um: Runs | None = Field(
        None, description="The same, approached in the negative direction [µm]"
    )
    backward_straightness_um: dict[str, Runs] = Field(
        default_factory=dict, description="The same of straightness [µm]"
    )
    backward_angular_urad: dict[str, Runs] = Field(
        default_factory=dict, description="The same of angles [µrad]"
    )
    measuring_line_mm: Point | None = Field(
        None, description="A point of the line on which the reflector moved [mm]"
    )
    tool_offset_mm: Point = Field(
        [0.0, 0.0, 0.0], description="Offset of the reflector as a tool [mm]"
    )
    straightness_line: Literal["as-read", "end-points", "least-squares"] = Field(
        "as-read", description="The line that is taken out of the straightness readings"
    )
    repeatability_urad: Repeatability | None = Field(
        None, description="Standard deviation of one angular reading, if read once [µrad]"
    )
