"""What the files of each method hold, and the bodies that are made of them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import Any, Final

from app.errors import list_names
from app.files.csv_columns import (
    ANGLE,
    EXPANSION,
    LENGTH,
    POSITION,
    SMALL_ANGLE,
    TEMPERATURE,
    Columns,
    Named,
    Quantity,
    find_columns,
    match_columns,
    normal_heading,
)
from app.files.csv_comments import Statement
from app.files.csv_measurements.formats import (
    MEASURING_LINE,
    REPEATABILITY,
    REPEATABILITY_OF_ANGLES,
    RUN,
    TOOL_OFFSET,
    Body,
    Format,
    Runs,
    axis_among,
    choice_among,
    flat_if_one,
    positions_and_runs,
    read_runs,
)
from app.files.delimited_text import DelimitedText, Row
from app.geometry.body_diagonal import DIAGONALS
from app.geometry.components import LINEAR_LETTERS, ROTATION_LETTERS, parse_component

_DIAGONAL: Final = Named("diagonal", None)
_AFTER: Final = tuple(Named(f"after_{axis}", LENGTH, (axis,)) for axis in "xyz")
_STEP: Final = Named("step", None)
_RANGES: Final = tuple(
    Statement(Named(f"volume_{axis}", POSITION), 2, f"volume_{axis}_mm: 0, 500") for axis in "xyz"
)
_BOTH_WAYS: Final = (Named("forward", LENGTH), Named("backward", LENGTH))

_DIRECTIONS: Final = {
    **dict.fromkeys(("forward", "+", "+1", "1", "up", "↑", "positive"), "forward"),
    **dict.fromkeys(("backward", "-", "\N{MINUS SIGN}", "-1", "down", "↓", "negative"), "backward"),
}
_NUMBERED: Final = re.compile(
    r"(?P<name>(?:(?:run_|cycle_)?(?P<before>\d+)_(?P<way>forward|backward)"
    r"|(?P<other>forward|backward)_?(?:run_|cycle_)?(?P<after>\d+)))(?:_.*)?"
)
_TARGET: Final = Named("target", POSITION, ("target_position", "position"))
_WAYS: Final = (Named("forward", LENGTH), Named("backward", LENGTH))
_ERROR: Final = Named("error", LENGTH, ("deviation",))
_PLACE_REACHED: Final = Quantity("mm", {u: f for u, f in POSITION.factors.items() if u != "um"})
"""In µm, what is called measured is a deviation."""

_ACTUAL: Final = Named(
    "actual", _PLACE_REACHED, ("measured", "actual_position", "measured_position")
)
_DIRECTION: Final = Named("direction", None, ("approach",))

_POSITION: Final = Named("position", POSITION)
_MEASURED: Final = Named("measured", LENGTH, ("deviation", "error"))

_ANGLE: Final = Named("angle", ANGLE)
_PLACE: Final = tuple(
    Named(axis, POSITION, (f"position_{axis}", f"{axis}_position")) for axis in "xyz"
)
_NOMINAL: Final = tuple(
    Named(f"nominal_{axis}", POSITION, (f"nom_{axis}", f"{axis}_nominal")) for axis in "xy"
)
_MEASURED_HOLES: Final = tuple(
    Named(f"measured_{axis}", POSITION, (f"meas_{axis}", f"{axis}_measured")) for axis in "xy"
)


def _read_step_diagonal(
    text: DelimitedText, statements: Mapping[str, Any], remarks: list[str]
) -> Body:
    columns = find_columns(text, [_DIAGONAL, *_AFTER], [_STEP], remarks)
    by_diagonal = _rows_by_diagonal(columns)
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


def _read_body_diagonal(
    text: DelimitedText, statements: Mapping[str, Any], remarks: list[str]
) -> Body:
    position = Named("position", POSITION, ("distance",))
    needed = [_DIAGONAL, position, _BOTH_WAYS[0]]
    columns = find_columns(text, needed, [_BOTH_WAYS[1], RUN], remarks)
    diagonals = {}
    for name, rows in _rows_by_diagonal(columns).items():
        positions, readings = read_runs(
            columns, "position", ["forward", "backward"], rows
        ).in_order()
        ways = {f"{way}_um": flat_if_one(runs) for way, runs in readings.items()}
        if positions and "forward_um" not in ways:
            columns.complain(rows[0], "forward", f"expected forward readings of {name}, got none")
        diagonals[name] = {"positions_mm": positions, **ways}
    return {**_with_volume(statements), "diagonals": diagonals}


def _with_volume(statements: Mapping[str, Any]) -> Body:
    """Put the ranges of the axes into one field."""
    ranges = {range_.thing.full: range_.thing.field[-1] for range_ in _RANGES}
    volume = {
        axis: dict(zip(("min_mm", "max_mm"), statements[name], strict=True))
        for name, axis in ranges.items()
        if statements.get(name)
    }
    rest = {name: value for name, value in statements.items() if name not in ranges}
    return rest | ({"volume": volume} if volume else {})


def _rows_by_diagonal(columns: Columns) -> dict[str, list[Row]]:
    by_diagonal: dict[str, list[Row]] = {}
    for row in columns.text.rows:
        name = columns.word(row, "diagonal").lower()
        if name in DIAGONALS:
            by_diagonal.setdefault(name, []).append(row)
        else:
            columns.complain(
                row, "diagonal", f"expected a diagonal among {list_names(DIAGONALS)}, got {name!r}"
            )
    return by_diagonal


STEP_DIAGONAL: Final = Format(
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
BODY_DIAGONAL: Final = Format((*_RANGES, REPEATABILITY), _read_body_diagonal)


def _read_positioning(
    text: DelimitedText, statements: Mapping[str, Any], remarks: list[str]
) -> Body:
    if any(_NUMBERED.fullmatch(normal_heading(heading)) for heading in text.headings):
        runs = _runs_in_columns(text, remarks)
    elif any(way.unit_in(heading) is not None for heading in text.headings for way in _WAYS):
        columns = find_columns(text, [_TARGET], [*_WAYS, RUN], remarks)
        runs = read_runs(columns, "target", [way.field for way in _WAYS], text.rows)
    else:
        has_error = any(_ERROR.unit_in(heading) is not None for heading in text.headings)
        value = _ERROR if has_error or not match_columns(text, [_ACTUAL]) else _ACTUAL
        runs = _runs_in_lines(find_columns(text, [_TARGET, value], [RUN, _DIRECTION], remarks))
    targets, readings = runs.in_order()
    if text.rows and "forward" not in readings and not text.problems.number:
        text.problems.add("expected forward readings, got none", text.heading_line)
    ways = {way.full: readings[way.field] for way in _WAYS if way.field in readings}
    return {**statements, "targets_mm": targets, **ways}


def _runs_in_columns(text: DelimitedText, remarks: list[str]) -> Runs:
    """Read columns such as `forward_1_um`: a line for each target."""
    matches = [_NUMBERED.fullmatch(normal_heading(heading)) for heading in text.headings]
    numbered = {match["name"]: match for match in matches if match}
    things = [Named(name, LENGTH) for name in numbered]
    columns = find_columns(text, [_TARGET, *things], [], remarks)
    runs = Runs(columns)
    for row, target, _ in positions_and_runs(columns, "target", text.rows):
        for name, match in numbered.items():
            number = float(match["before"] or match["after"])
            value = columns.needed(row, name)
            runs.add(row, target, match["way"] or match["other"], value, number)
    return runs


def _runs_in_lines(columns: Columns) -> Runs:
    """Read a line for each reading; all are forward where no direction is stated."""
    runs = Runs(columns)
    for row, target, run in positions_and_runs(columns, "target", columns.text.rows):
        value = columns.needed(row, "error" if "error" in columns else "actual")
        if value is not None and "actual" in columns:
            # In decimal, so that 0.2399 less 0.24 mm is −0.1 µm and not −0.1 and a bit.
            less_mm = Decimal(repr(value)) - Decimal(repr(target))
            value = LENGTH.convert(float(less_mm), "mm")
        written = columns.word(row, "direction").lower() if "direction" in columns else "forward"
        direction = _DIRECTIONS.get(written)
        if direction is None:
            columns.complain(
                row, "direction", f"expected forward or backward (+ or -), got {written!r}"
            )
        else:
            runs.add(row, target, direction, value, run)
    return runs


POSITIONING: Final = Format((axis_among(*LINEAR_LETTERS), REPEATABILITY), _read_positioning)


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
