"""Six errors of one axis, read together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

from pydantic import Field

from app.api.methods.method import Method
from app.errors import list_names
from app.files.csv_columns import (
    LENGTH,
    POSITION,
    SMALL_ANGLE,
    Named,
    Quantity,
    find_columns,
)
from app.files.csv_measurements.formats import (
    MEASURING_LINE,
    REPEATABILITY,
    REPEATABILITY_OF_ANGLES,
    RUN,
    TOOL_OFFSET,
    Body,
    Format,
    axis_among,
    choice_among,
    flat_if_one,
    read_runs,
)
from app.files.delimited_text import DelimitedText
from app.geometry.components import LINEAR_LETTERS, ROTATION_LETTERS
from app.measurement.result import Evaluated
from app.measurement.six_dof import evaluate_six_dof
from app.pages.wording import message
from app.services.context import Context
from app.services.measurements import (
    Axis,
    MeasuredPositions,
    MeasurementRequest,
    Repeatability,
    Runs,
)
from app.stated import Point
from app.thermal.machine import Machine


class SixDofRequest(
    MeasurementRequest,
    example={
        "axis": "x",
        "positions_mm": [0, 250, 500],
        "linear_um": [0, 1.4, 2.9],
        "straightness_um": {"y": [0, 0.6, 0.1], "z": [0, -0.4, 0.3]},
        "angular_urad": {"a": [0, 2, 5], "b": [0, 8, 15], "c": [0, -3, -4]},
        "measuring_line_mm": [0, 250, 100],
    },
):
    """Up to six errors of one axis, read together."""

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
        (0.0, 0.0, 0.0), description="Offset of the reflector as a tool [mm]"
    )
    straightness_line: Literal["as-read", "end-points", "least-squares"] = Field(
        "as-read", description="The line that is taken out of the straightness readings"
    )
    repeatability_urad: Repeatability | None = Field(
        None, description="Standard deviation of one angular reading, if read once [µrad]"
    )


def _evaluate(_context: Context, _machine: Machine, body: SixDofRequest) -> Evaluated:
    result = evaluate_six_dof(
        body.axis,
        body.positions_mm,
        body.linear_um,
        body.straightness_um,
        body.angular_urad,
        backward_linear_um=body.backward_linear_um,
        backward_straightness_um=body.backward_straightness_um,
        backward_angular_urad=body.backward_angular_urad,
        measuring_line_mm=body.measuring_line_mm,
        tool_offset_mm=body.tool_offset_mm,
        straightness_line=body.straightness_line,
        repeatability_um=body.repeatability_um,
        repeatability_urad=body.repeatability_urad,
    )
    return Evaluated(result=result)


_POSITION: Final = Named("position", POSITION)


@dataclass(frozen=True, slots=True)
class _Error:
    """One of an axis' errors: its column, and its place in the body."""

    column: Named
    field: str
    letter: str = ""


def _read_six_dof(text: DelimitedText, statements: Mapping[str, Any], remarks: list[str]) -> Body:
    if statements.get("axis") is None:
        text.problems.raise_if_any()
    errors = list(_errors_of(statements["axis"]))
    columns = find_columns(text, [_POSITION], [*(one.column for one in errors), RUN], remarks)
    names = [one.column.field for one in errors]
    if not any(name in columns for name in names):
        text.problems.add(
            f"expected columns of the axis {statements['axis']} among "
            f"{list_names(one.column.full for one in errors)}, got {list_names(text.headings)}",
            text.heading_line,
        )
    positions, readings = read_runs(columns, "position", names, text.rows).in_order()
    body: Body = {**statements, "positions_mm": positions}
    for error_column in errors:
        if error_column.column.field in readings:
            runs = flat_if_one(readings[error_column.column.field])
            if error_column.letter:
                body.setdefault(error_column.field, {})[error_column.letter] = runs
            else:
                body[error_column.field] = runs
    return body


def _errors_of(axis: str) -> Iterator[_Error]:
    """List the six errors of an axis both ways; ISO 230-1's codes name their columns too."""
    for way in ("", "backward_"):

        def column(name: str, direction: str, quantity: Quantity, way: str = way) -> Named:
            return Named(f"{way}{name}", quantity, (f"{way}e{direction}{axis}",))

        yield _Error(column("linear", axis, LENGTH), f"{way}linear_um")
        for letter in LINEAR_LETTERS.replace(axis, ""):
            named = column(f"straightness_{letter}", letter, LENGTH)
            yield _Error(named, f"{way}straightness_um", letter)
        for letter in ROTATION_LETTERS:
            named = column(f"angular_{letter}", letter, SMALL_ANGLE)
            yield _Error(named, f"{way}angular_urad", letter)


_FILE: Final = Format(
    (
        axis_among(*LINEAR_LETTERS),
        MEASURING_LINE,
        TOOL_OFFSET,
        choice_among("straightness_line", "as-read", "end-points", "least-squares"),
        REPEATABILITY,
        REPEATABILITY_OF_ANGLES,
    ),
    _read_six_dof,
)


SIX_DOF: Final = Method(
    name="six-dof",
    title=message("six errors of one axis"),
    summary="Six errors of one axis (Y.-Y. Hsu)",
    about="Take displacement, straightness and angles of one axis with their measuring line.",
    request=SixDofRequest,
    evaluate=_evaluate,
    file=_FILE,
)
