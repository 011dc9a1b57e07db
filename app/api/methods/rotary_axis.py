"""R-test of a rotary axis: the places of a ball that it carries."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final

from pydantic import Field

from app.api.methods.method import Method
from app.files.csv_columns import (
    ANGLE,
    POSITION,
    Named,
    find_columns,
)
from app.files.csv_comments import Statement
from app.files.csv_measurements.formats import (
    REPEATABILITY,
    Body,
    Format,
    axis_among,
)
from app.files.delimited_text import DelimitedText
from app.in_pieces import InPieces
from app.measurement.rotary_axis import RotaryAxisMeasurement, measure_rotary_axis
from app.pages.wording import message
from app.services.context import Context
from app.services.measurements import MeasurementAnswer, MeasurementRequest
from app.stated import Number, Point, Schema
from app.thermal.machine import Machine


class BallSchema(Schema):
    """The ball of an R-test at one angle."""

    angle_deg: Number = Field(description="Angle of the rotary axis [°]")
    position_mm: Point = Field(description="The ball's x, y, z [mm]")


class RotaryAxisRequest(
    MeasurementRequest,
    example={
        "axis": "C",
        "points": [
            {"angle_deg": 0, "position_mm": [101.0, 0.0, 50.0]},
            {"angle_deg": 90, "position_mm": [0.0, 101.0, 50.0]},
            {"angle_deg": 180, "position_mm": [-101.0, 0.0, 50.0]},
        ],
    },
):
    """Places of a ball that a rotary axis carries."""

    axis: str = Field(description="The rotary axis, A, B or C", examples=["C"])
    points: Annotated[list[BallSchema], InPieces(5000)] = Field(
        description="The ball at each angle"
    )
    pivot_mm: Point = Field((0.0, 0.0, 0.0), description="A point of the nominal axis [mm]")


@dataclass(frozen=True, eq=False, kw_only=True)
class RotaryAxisAnswer(MeasurementAnswer, RotaryAxisMeasurement):
    """The axis' location errors, with run-out in `figures`."""


def _evaluate(
    _context: Context, _machine: Machine, body: RotaryAxisRequest
) -> RotaryAxisMeasurement:
    return measure_rotary_axis(
        body.axis,
        [ball.angle_deg for ball in body.points],
        [ball.position_mm for ball in body.points],
        repeatability_um=body.repeatability_um,
        pivot_mm=body.pivot_mm,
    )


_ANGLE: Final = Named("angle", ANGLE)


_PLACE: Final = tuple(
    Named(axis, POSITION, (f"position_{axis}", f"{axis}_position")) for axis in "xyz"
)


def _read_rotary_axis(
    text: DelimitedText, statements: Mapping[str, Any], remarks: list[str]
) -> Body:
    columns = find_columns(text, [_ANGLE, *_PLACE], [], remarks)
    points = [
        {
            "angle_deg": columns.needed(row, "angle"),
            "position_mm": [columns.needed(row, place.field) for place in _PLACE],
        }
        for row in text.rows
    ]
    return {**statements, "points": points}


_FILE: Final = Format(
    (
        axis_among("C", "A", "B"),
        Statement(Named("pivot", POSITION), 3, "pivot_mm: 0, 0, -500"),
        REPEATABILITY,
    ),
    _read_rotary_axis,
)


ROTARY_AXIS: Final = Method(
    name="rotary-axis",
    title=message("a rotary axis (R-test)"),
    summary="R-test of a rotary axis",
    about="Find how a rotary axis lies from the places of a ball that it carries.",
    request=RotaryAxisRequest,
    answer=RotaryAxisAnswer,
    evaluate=_evaluate,
    file=_FILE,
)
