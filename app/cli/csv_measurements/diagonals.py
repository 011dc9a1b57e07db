"""Readings on the four body diagonals, continuous or axis after axis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from app.cli.csv_measurements.columns import Columns, find_columns
from app.cli.csv_measurements.comments import Statement
from app.cli.csv_measurements.formats import (
    REPEATABILITY,
    RUN,
    TOOL_OFFSET,
    Body,
    Format,
    choice_among,
)
from app.cli.csv_measurements.quantities import LENGTH, POSITION, SMALL_ANGLE, Named
from app.cli.csv_measurements.runs import flat_if_one, read_runs
from app.cli.delimited_text import DelimitedText, Row
from app.errors import list_names
from app.geometry.body_diagonal import DIAGONALS

_DIAGONAL: Final = Named("diagonal", None)
_AFTER: Final = tuple(Named(f"after_{axis}", LENGTH, (axis,)) for axis in "xyz")
_STEP: Final = Named("step", None)
_RANGES: Final = tuple(
    Statement(Named(f"volume_{axis}", POSITION), 2, f"volume_{axis}_mm: 0, 500") for axis in "xyz"
)
_BOTH_WAYS: Final = (Named("forward", LENGTH), Named("backward", LENGTH))


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
    ordered = sorted(numbered, key=lambda one: one[0])
    for expected, (step, row) in enumerate(ordered, start=1):
        if step != expected:
            columns.complain(row, "step", f"expected step {expected} of {name} next, came {step:g}")
            break
    return [row for _, row in ordered]


def _complain_of_lengths(columns: Columns, by_diagonal: Mapping[str, list[Row]]) -> None:
    counts = {name: len(rows) for name, rows in by_diagonal.items()}
    longest = max(counts, key=lambda name: counts[name], default="")
    for name, rows in by_diagonal.items():
        if counts[name] < counts[longest]:
            columns.text.problems.add(
                f"expected {counts[longest]} steps of {name} as of {longest}, came {counts[name]}",
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
            columns.complain(rows[0], "forward", f"expected forward readings of {name}, came none")
        diagonals[name] = {"positions_mm": positions, **ways}
    return {**_with_volume(statements), "diagonals": diagonals}


def _with_volume(statements: Mapping[str, Any]) -> Body:
    """Put the ranges of the axes into one field."""
    ranges = {one.thing.full: one.thing.field[-1] for one in _RANGES}
    volume = {
        axis: dict(zip(("min_mm", "max_mm"), statements[name], strict=True))
        for name, axis in ranges.items()
        if statements.get(name)
    }
    rest = {name: value for name, value in statements.items() if name not in ranges}
    return rest | ({"volume": volume} if volume else {})


def _rows_by_diagonal(columns: Columns) -> dict[str, list[Row]]:
    found: dict[str, list[Row]] = {}
    for row in columns.text.rows:
        name = columns.word(row, "diagonal").lower()
        if name in DIAGONALS:
            found.setdefault(name, []).append(row)
        else:
            columns.complain(
                row, "diagonal", f"expected a diagonal among {list_names(DIAGONALS)}, came {name!r}"
            )
    return found


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
