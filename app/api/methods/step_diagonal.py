"""Sequential step diagonals (C. Wang)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

from pydantic import Field

from app.api.methods.method import Method
from app.files.csv_columns import (
    LENGTH,
    POSITION,
    SMALL_ANGLE,
    Columns,
    Named,
    find_columns,
)
from app.files.csv_comments import Statement
from app.files.csv_measurements.formats import (
    DIAGONAL,
    REPEATABILITY,
    TOOL_OFFSET,
    Body,
    Format,
    choice_among,
    rows_by_diagonal,
)
from app.files.delimited_text import DelimitedText, Row
from app.geometry.error_table import Table
from app.measurement.step_diagonal import StepDiagonal, step_diagonal
from app.pages.wording import message
from app.services.context import Context
from app.services.measurements import MeasurementAnswer, MeasurementRequest
from app.stated import Number, Point
from app.thermal.error_map import StatedTable
from app.thermal.machine import Machine

Triple = Annotated[list[Number], Field(min_length=3, max_length=3)]


Rows = Annotated[list[Triple], Field(min_length=1, max_length=1000)]


class StepDiagonalRequest(
    MeasurementRequest,
    example={
        "origin_mm": [0, 0, 0],
        "step_mm": [100, 100, 80],
        "diagonals": {
            "ppp": [[0.4, 0.9, 1.1], [1.6, 2.0, 2.3]],
            "npp": [[0.2, 0.7, 0.9], [1.1, 1.6, 1.8]],
            "pnp": [[0.5, 0.8, 1.0], [1.4, 1.8, 2.1]],
            "ppn": [[0.3, 0.8, 0.9], [1.3, 1.7, 1.8]],
        },
    },
):
    """Readings of a laser along body diagonals, after each single step of x, y and z."""

    origin_mm: Point = Field(description="Lowest corner x, y, z of the volume [mm]")
    step_mm: Point = Field(description="Length of a step of x, y and z [mm]")
    diagonals: dict[str, Rows] = Field(
        description="Diagonal (ppp, npp, pnp, ppn) to a row for each step: displacement along the "
        "diagonal since its start less its nominal, after x, after y, after z [µm]"
    )
    line: Literal["end-points", "least-squares"] = Field(
        "end-points", description="The line from which straightness counts"
    )
    tool_offset_mm: Point = Field(
        (0.0, 0.0, 0.0), description="Tool offset of the target's middle [mm]"
    )
    target: Literal["point", "flat-mirror"] = Field(
        "point", description="What reflects; it decides what known angular errors do"
    )
    mirror_angle_urad: Annotated[Number, Field(ge=0)] | None = Field(
        None,
        description="Standard uncertainty of each of the mirror's two tilts [µrad]; what the "
        "closures show if left out",
    )
    angular: list[StatedTable] = Field(
        default_factory=list,
        max_length=60,
        description="Known angular errors, whose effect is taken out of the readings [µrad]",
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class StepDiagonalAnswer(MeasurementAnswer, StepDiagonal):
    """Nine translations and three squareness errors."""


def _evaluate(_context: Context, machine: Machine, body: StepDiagonalRequest) -> StepDiagonal:
    return step_diagonal(
        machine.chain,
        body.origin_mm,
        body.step_mm,
        body.diagonals,
        line=body.line,
        angular={t.component.code: Table(t.positions_mm, t.errors) for t in body.angular},
        tool_offset_mm=body.tool_offset_mm,
        target=body.target,
        repeatability_um=body.repeatability_um,
        mirror_angle_urad=body.mirror_angle_urad,
        travel_mm={axis: (t.min_mm, t.max_mm) for axis, t in machine.axes.items()},
    )


_AFTER: Final = tuple(Named(f"after_{axis}", LENGTH, (axis,)) for axis in "xyz")


_STEP: Final = Named("step", None)


def _read_step_diagonal(
    text: DelimitedText, statements: Mapping[str, Any], remarks: list[str]
) -> Body:
    columns = find_columns(text, [DIAGONAL, *_AFTER], [_STEP], remarks)
    by_diagonal = rows_by_diagonal(columns)
    diagonals = {}
    for name, rows in by_diagonal.items():
        ordered = _in_order_of_steps(columns, name, rows)
        diagonals[name] = [[columns.needed(row, a.field) for a in _AFTER] for row in ordered]
    _complain_of_lengths(columns, by_diagonal)
    return {**statements, "diagonals": diagonals}


def _in_order_of_steps(columns: Columns, name: str, rows: list[Row]) -> list[Row]:
    """Put a diagonal's lines in order of a column `step`, else as they stand."""
    if "step" not in columns:
        return rows
    numbered = [(n, row) for row in rows if (n := columns.needed(row, "step")) is not None]
    if len(numbered) < len(rows):
        return rows
    ordered = sorted(numbered, key=lambda pair: pair[0])
    for expected, (step, row) in enumerate(ordered, start=1):
        if step != expected:
            columns.complain(row, "step", f"expected step {expected} of {name} next, got {step:g}")
            break
    return [row for _, row in ordered]


def _complain_of_lengths(columns: Columns, by_diagonal: Mapping[str, list[Row]]) -> None:
    counts = {name: len(rows) for name, rows in by_diagonal.items()}
    longest = max(counts, key=lambda name: counts[name], default="")
    for name, rows in by_diagonal.items():
        if counts[name] < counts[longest]:
            columns.text.problems.add(
                f"expected {counts[longest]} steps of {name} as of {longest}, got {counts[name]}",
                rows[-1].line,
            )


_FILE: Final = Format(
    (
        Statement(Named("origin", POSITION), 3, "origin_mm: 0, 0, 0", True),
        Statement(Named("step", POSITION), 3, "step_mm: 50, 40, 30", True),
        choice_among("line", "end-points", "least-squares"),
        choice_among("target", "point", "flat-mirror"),
        TOOL_OFFSET,
        REPEATABILITY,
        Statement(Named("mirror_angle", SMALL_ANGLE), 1, "mirror_angle_urad: 50"),
    ),
    _read_step_diagonal,
)


STEP_DIAGONAL: Final = Method(
    name="step-diagonal",
    title=message("sequential step diagonals"),
    summary="Sequential step diagonal (C. Wang)",
    about="Derive nine translations and three squareness errors from three or four diagonals.",
    request=StepDiagonalRequest,
    answer=StepDiagonalAnswer,
    evaluate=_evaluate,
    file=_FILE,
)
