"""Machined parts, drilled plates and R-tests over HTTP."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import ConfigDict, Field

from app.api.schemas.base import Millimetres, Number, Point, Schema
from app.api.schemas.in_pieces import InPieces
from app.api.schemas.measurements.base import (
    MeasuredPositions,
    MeasurementAnswer,
    MeasurementRequest,
    Runs,
)
from app.rounding import Digits, Micro

if TYPE_CHECKING:
    from app.measurement.machined_part import Comparison

PlanePoint = Annotated[list[Millimetres], Field(min_length=2, max_length=2)]


class MachinedPartRequest(MeasurementRequest):
    """Points along an edge that one axis machined, measured on a coordinate machine."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "component": "EXY",
                "positions_mm": [0, 50, 100, 150],
                "measured_um": [0.0, 1.2, 1.6, 0.7],
                "temperatures_c": {"x-middle": 24.1, "z-column": 27.3},
            }
        }
    )

    component: str = Field(
        description="Straightness component: EXY is an edge along y with deviations in x",
        examples=["EXY"],
    )
    positions_mm: MeasuredPositions = Field(description="Positions along the edge's axis [mm]")
    measured_um: Runs = Field(
        description="Actual minus nominal position of the edge, one pass or several [µm]"
    )
    line: Literal["least-squares", "end-points"] = Field(
        "least-squares", description="The line from which straightness counts"
    )
    measuring_line_mm: Point | None = Field(
        None, description="A point of the machine's path along the edge [mm]"
    )
    tool_offset_mm: Point = Field(
        [0.0, 0.0, 0.0], description="Tool offset with which it was cut [mm]"
    )


class ComparisonAnswer(Schema):
    """What the part says against what the model says."""

    predicted_um: list[Micro] = Field(description="The model's error at each position [µm]")
    model_version: int = Field(description="Version of the model")
    bias_um: Micro = Field(description="Mean of measured minus predicted [µm]")
    slope_difference_um_per_m: Micro = Field(description="Slope of measured minus predicted [µm/m]")
    rms_difference_um: Micro = Field(
        description="Root mean square of measured minus predicted, as both came [µm]"
    )
    rms_without_line_um: Micro = Field(
        description="The same without the reference line of both [µm]"
    )
    r: Digits | None = Field(description="Correlation of both without their lines")
    confidence_95: list[Digits] | None = Field(description="Its 95 % confidence interval")

    @classmethod
    def of(cls, comparison: Comparison, predicted_um: list[float], model_version: int) -> Self:
        """Show a comparison."""
        return cls(
            predicted_um=predicted_um,
            model_version=model_version,
            bias_um=comparison.bias_um,
            slope_difference_um_per_m=comparison.slope_difference_um_per_m,
            rms_difference_um=comparison.rms_difference_um,
            rms_without_line_um=comparison.rms_without_line_um,
            r=comparison.correlation,
            confidence_95=None if comparison.interval is None else list(comparison.interval),
        )


class MachinedPartAnswer(MeasurementAnswer):
    """The straightness of the edge, and how it compares with the model."""

    straightness_um: Micro = Field(description="Range of the deviations from the line [µm]")
    slope_um_per_m: Micro = Field(description="Slope that was taken out [µm/m]")
    suspicious: list[int] = Field(
        description="Indices of measured points far from the rest, from 0; they are kept"
    )
    comparison: ComparisonAnswer | None = Field(
        description="With the active model at `temperatures_c`; null where there is no model"
    )


class HoleSchema(Schema):
    """One hole of a plate."""

    nominal_mm: PlanePoint = Field(description="Nominal x, y on the plate [mm]")
    measured_mm: PlanePoint = Field(description="Measured x, y [mm]")


class DrilledPlateRequest(MeasurementRequest):
    """The holes of a plate, measured on a coordinate machine."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "holes": [
                    {"nominal_mm": [0, 0], "measured_mm": [0, 0]},
                    {"nominal_mm": [200, 0], "measured_mm": [200.004, 0]},
                    {"nominal_mm": [0, 100], "measured_mm": [0.001, 100]},
                    {"nominal_mm": [200, 100], "measured_mm": [200.005, 100]},
                ]
            }
        }
    )

    holes: Annotated[list[HoleSchema], InPieces(5000)] = Field(
        description="Nominal and measured places of the holes"
    )
    origin_mm: Point | None = Field(
        None, description="Machine position at the plate's nominal zero [mm]"
    )
    tool_offset_mm: Point = Field(
        [0.0, 0.0, 0.0], description="Tool offset with which it was drilled [mm]"
    )
    expansion_um_per_m_k: Number = Field(
        0.0, description="The plate's coefficient of expansion, per K [µm/m]", examples=[11.5]
    )
    drilled_minus_measured_c: Number = Field(
        0.0, description="The plate's temperature when drilled minus when measured [°C]"
    )


class DrilledPlateAnswer(MeasurementAnswer):
    """Scale, squareness and axis errors, up to a rigid motion."""

    rotation_urad: Micro = Field(description="How the plate lay, about Z [µrad]")
    shift_mm: list[Digits] = Field(description="Where its nominal zero lay [mm]")
    scale_um_per_m: list[Micro] = Field(description="Scale of x and y [µm/m]")
    scale_standard_errors_um_per_m: list[Digits | None] = Field(
        description="Their standard errors [µm/m]"
    )
    squareness_um_per_m: Micro = Field(description="SXY [µm/m]")
    residuals_um: list[list[Micro]] = Field(
        description="What rigid motion, scale and squareness leave of each hole's x, y [µm]"
    )
    suspicious: list[int] = Field(
        description="Indices of holes far from the rest, from 0; they are kept"
    )


class BallSchema(Schema):
    """The ball of an R-test at one angle."""

    angle_deg: Number = Field(description="Angle of the rotary axis [°]")
    position_mm: Point = Field(description="The ball's x, y, z [mm]")


class RotaryAxisRequest(MeasurementRequest):
    """Places of a ball that a rotary axis carries."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "axis": "C",
                "points": [
                    {"angle_deg": 0, "position_mm": [101.0, 0.0, 50.0]},
                    {"angle_deg": 90, "position_mm": [0.0, 101.0, 50.0]},
                    {"angle_deg": 180, "position_mm": [-101.0, 0.0, 50.0]},
                ],
            }
        }
    )

    axis: str = Field(description="The rotary axis, A, B or C", examples=["C"])
    points: Annotated[list[BallSchema], InPieces(5000)] = Field(
        description="The ball at each angle"
    )
    pivot_mm: Point = Field([0.0, 0.0, 0.0], description="A point of the nominal axis [mm]")


class PathErrorsAnswer(Schema):
    """How far the ball was beside the spindle that follows it, point by point."""

    before_um: list[list[Micro]] = Field(
        description="Following the nominal axis: x, y, z, measured minus followed place [µm]"
    )
    after_position_um: list[list[Micro]] = Field(
        description="Following an axis of nominal direction through the actual axis' place at the "
        "ball: its two position errors compensated [µm]"
    )
    after_all_um: list[list[Micro]] = Field(
        description="Following the axis that was found: all its errors compensated [µm]. At the "
        "points that showed them; at others it may be more"
    )


class RotaryAxisAnswer(MeasurementAnswer):
    """The axis' location errors, with run-out in `figures`."""

    residuals_um: list[list[Micro]] = Field(
        description="Measured minus fitted place of the ball: radial, tangential, axial [µm]"
    )
    noise_um: Digits | None = Field(
        description="Standard deviation of one coordinate, from the residuals or as stated [µm]"
    )
    degrees_of_freedom: int = Field(description="Of that noise")
    path: PathErrorsAnswer = Field(
        description="The path errors before and after compensation; rms and largest length are in "
        "`figures` [µm]"
    )
