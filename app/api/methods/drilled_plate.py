"""The holes of a drilled plate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final

from pydantic import Field

from app.api.methods.method import Method
from app.errors import InvalidContent
from app.files.csv_columns import (
    EXPANSION,
    POSITION,
    TEMPERATURE,
    Named,
    find_columns,
)
from app.files.csv_comments import Statement
from app.files.csv_measurements.formats import (
    REPEATABILITY,
    TOOL_OFFSET,
    Body,
    Format,
)
from app.files.delimited_text import DelimitedText
from app.in_pieces import InPieces
from app.measurement.drilled_plate import DrilledPlate, evaluate_drilled_plate
from app.pages.wording import message
from app.services.context import Context
from app.services.measurements import MeasurementAnswer, MeasurementRequest
from app.stated import Millimetres, Number, Point, Schema
from app.thermal.machine import Machine

PlanePoint = Annotated[list[Millimetres], Field(min_length=2, max_length=2)]


class HoleSchema(Schema):
    """One hole of a plate."""

    nominal_mm: PlanePoint = Field(description="Nominal x, y on the plate [mm]")
    measured_mm: PlanePoint = Field(description="Measured x, y [mm]")


class DrilledPlateRequest(
    MeasurementRequest,
    example={
        "holes": [
            {"nominal_mm": [0, 0], "measured_mm": [0, 0]},
            {"nominal_mm": [200, 0], "measured_mm": [200.004, 0]},
            {"nominal_mm": [0, 100], "measured_mm": [0.001, 100]},
            {"nominal_mm": [200, 100], "measured_mm": [200.005, 100]},
        ]
    },
):
    """The holes of a plate, measured on a coordinate machine."""

    holes: Annotated[list[HoleSchema], InPieces(5000)] = Field(
        description="Nominal and measured places of the holes"
    )
    origin_mm: Point | None = Field(
        None, description="Machine position at the plate's nominal zero [mm]"
    )
    tool_offset_mm: Point = Field(
        (0.0, 0.0, 0.0), description="Tool offset with which it was drilled [mm]"
    )
    expansion_um_per_m_k: Number = Field(
        0.0, description="The plate's coefficient of expansion, per K [µm/m]", examples=[11.5]
    )
    drilled_minus_measured_c: Number = Field(
        0.0, description="The plate's temperature when drilled minus when measured [°C]"
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class DrilledPlateAnswer(MeasurementAnswer, DrilledPlate):
    """Scale, squareness and axis errors, up to a rigid motion."""


def _evaluate(_context: Context, _machine: Machine, body: DrilledPlateRequest) -> DrilledPlate:
    try:
        return evaluate_drilled_plate(
            [hole.nominal_mm for hole in body.holes],
            [hole.measured_mm for hole in body.holes],
            origin_mm=body.origin_mm,
            tool_offset_mm=body.tool_offset_mm,
            expansion_um_per_m_k=body.expansion_um_per_m_k,
            drilled_minus_measured_c=body.drilled_minus_measured_c,
            repeatability_um=body.repeatability_um,
        )
    except InvalidContent as error:
        raise _of_holes(error) from None


def _of_holes(error: InvalidContent) -> InvalidContent:
    """Name the holes' fields as the body has them."""
    columns = {"nominal_mm", "measured_mm"}
    return error.inside("holes") if {e.field for e in error.errors} <= columns else error


_NOMINAL: Final = tuple(
    Named(f"nominal_{axis}", POSITION, (f"nom_{axis}", f"{axis}_nominal")) for axis in "xy"
)


_MEASURED_HOLES: Final = tuple(
    Named(f"measured_{axis}", POSITION, (f"meas_{axis}", f"{axis}_measured")) for axis in "xy"
)


def _read_drilled_plate(
    text: DelimitedText, statements: Mapping[str, Any], remarks: list[str]
) -> Body:
    columns = find_columns(text, [*_NOMINAL, *_MEASURED_HOLES], [], remarks)
    holes = [
        {
            "nominal_mm": [columns.needed(row, column.field) for column in _NOMINAL],
            "measured_mm": [columns.needed(row, column.field) for column in _MEASURED_HOLES],
        }
        for row in text.rows
    ]
    return {**statements, "holes": holes}


_FILE: Final = Format(
    (
        Statement(Named("origin", POSITION), 3, "origin_mm: 100, 100, 50"),
        TOOL_OFFSET,
        Statement(Named("expansion", EXPANSION), 1, "expansion_um_per_m_k: 11.5"),
        Statement(Named("drilled_minus_measured", TEMPERATURE), 1, "drilled_minus_measured_c: 3.5"),
        REPEATABILITY,
    ),
    _read_drilled_plate,
)


DRILLED_PLATE: Final = Method(
    name="drilled-plate",
    title=message("a drilled plate"),
    summary="Holes of a drilled plate",
    about="Take scale, squareness and axis errors from holes, up to a rigid motion.",
    request=DrilledPlateRequest,
    answer=DrilledPlateAnswer,
    evaluate=_evaluate,
    file=_FILE,
)
