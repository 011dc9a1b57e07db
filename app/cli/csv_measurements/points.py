"""Points in space or in a plane: a ball on a rotary axis, the holes of a drilled plate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from app.cli.csv_measurements.columns import find_columns
from app.cli.csv_measurements.comments import Statement
from app.cli.csv_measurements.formats import (
    REPEATABILITY,
    TOOL_OFFSET,
    Body,
    Format,
    axis_among,
)
from app.cli.csv_measurements.quantities import ANGLE, EXPANSION, POSITION, TEMPERATURE, Named
from app.cli.delimited_text import DelimitedText

_ANGLE: Final = Named("angle", ANGLE)
_PLACE: Final = tuple(
    Named(axis, POSITION, (f"position_{axis}", f"{axis}_position")) for axis in "xyz"
)
_NOMINAL: Final = tuple(
    Named(f"nominal_{axis}", POSITION, (f"nom_{axis}", f"{axis}_nominal")) for axis in "xy"
)
_MEASURED: Final = tuple(
    Named(f"measured_{axis}", POSITION, (f"meas_{axis}", f"{axis}_measured")) for axis in "xy"
)


def _read_rotary_axis(
    text: DelimitedText, statements: Mapping[str, Any], remarks: list[str]
) -> Body:
    columns = find_columns(text, [_ANGLE, *_PLACE], [], remarks)
    points = [
        {
            "angle_deg": columns.needed(row, "angle"),
            "position_mm": [columns.needed(row, one.field) for one in _PLACE],
        }
        for row in text.rows
    ]
    return {**statements, "points": points}


def _read_drilled_plate(
    text: DelimitedText, statements: Mapping[str, Any], remarks: list[str]
) -> Body:
    columns = find_columns(text, [*_NOMINAL, *_MEASURED], [], remarks)
    holes = [
        {
            "nominal_mm": [columns.needed(row, one.field) for one in _NOMINAL],
            "measured_mm": [columns.needed(row, one.field) for one in _MEASURED],
        }
        for row in text.rows
    ]
    return {**statements, "holes": holes}


ROTARY_AXIS: Final = Format(
    (
        axis_among("C", "A", "B"),
        Statement(Named("pivot", POSITION), 3, "pivot_mm: 0, 0, -500"),
        REPEATABILITY,
    ),
    _read_rotary_axis,
)
DRILLED_PLATE: Final = Format(
    (
        Statement(Named("origin", POSITION), 3, "origin_mm: 100, 100, 50"),
        TOOL_OFFSET,
        Statement(Named("expansion", EXPANSION), 1, "expansion_um_per_m_k: 11.5"),
        Statement(Named("drilled_minus_measured", TEMPERATURE), 1, "drilled_minus_measured_c: 3.5"),
        REPEATABILITY,
    ),
    _read_drilled_plate,
)
