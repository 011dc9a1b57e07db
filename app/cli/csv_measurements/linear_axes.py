"""Readings along a linear axis: six degrees of freedom, and the edge of a machined part."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from app.cli.csv_measurements.columns import find_columns
from app.cli.csv_measurements.comments import Statement
from app.cli.csv_measurements.formats import (
    MEASURING_LINE,
    REPEATABILITY,
    REPEATABILITY_OF_ANGLES,
    RUN,
    TOOL_OFFSET,
    Body,
    Format,
    axis_among,
    choice_among,
)
from app.cli.csv_measurements.quantities import (
    LENGTH,
    POSITION,
    SMALL_ANGLE,
    Named,
    Quantity,
)
from app.cli.csv_measurements.runs import Runs, flat_if_one, positions_and_runs, read_runs
from app.cli.delimited_text import DelimitedText
from app.errors import list_names
from app.geometry.components import LINEAR_LETTERS, ROTATION_LETTERS, parse_component

_POSITION: Final = Named("position", POSITION)
_MEASURED: Final = Named("measured", LENGTH, ("deviation", "error"))


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
            f"{list_names(one.column.full for one in errors)}, came {list_names(text.headings)}",
            text.heading_line,
        )
    positions, readings = read_runs(columns, "position", names, text.rows).in_order()
    body: Body = {**statements, "positions_mm": positions}
    for one in errors:
        if one.column.field in readings:
            runs = flat_if_one(readings[one.column.field])
            if one.letter:
                body.setdefault(one.field, {})[one.letter] = runs
            else:
                body[one.field] = runs
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


def _read_machined_part(
    text: DelimitedText, statements: Mapping[str, Any], remarks: list[str]
) -> Body:
    columns = find_columns(text, [_POSITION, _MEASURED], [RUN], remarks)
    runs = Runs(columns)
    for row, at, run in positions_and_runs(columns, "position", text.rows):
        runs.add(row, at, "measured", columns.needed(row, "measured"), run)
    positions, readings = runs.in_order()
    measured = flat_if_one(readings.get("measured", [[]]))
    return {**statements, "positions_mm": positions, "measured_um": measured}


def _component_word(text: str) -> str:
    """Refuse what is no component; its name stays as written."""
    parse_component(text)
    return text


SIX_DOF: Final = Format(
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
MACHINED_PART: Final = Format(
    (
        Statement(Named("component", None), 0, "component: EXY", True, _component_word),
        choice_among("line", "least-squares", "end-points"),
        MEASURING_LINE,
        TOOL_OFFSET,
        REPEATABILITY,
    ),
    _read_machined_part,
)
