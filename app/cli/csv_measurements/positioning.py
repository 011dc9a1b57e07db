"""Positioning by ISO 230-2: targets, runs and directions in any of three arrangements."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

from app.cli.csv_measurements.columns import Columns, find_columns
from app.cli.csv_measurements.formats import REPEATABILITY, RUN, Body, Format, axis_among
from app.cli.csv_measurements.quantities import LENGTH, POSITION, Named, normal_heading
from app.cli.csv_measurements.runs import Runs, positions_and_runs, read_runs
from app.cli.delimited_text import DelimitedText
from app.geometry.components import LINEAR_LETTERS

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
_DIRECTION: Final = Named("direction", None, ("approach",))


def _read_positioning(
    text: DelimitedText, statements: Mapping[str, Any], remarks: list[str]
) -> Body:
    if any(_NUMBERED.fullmatch(normal_heading(heading)) for heading in text.headings):
        runs = _runs_in_columns(text, remarks)
    elif any(way.unit_in(heading) is not None for heading in text.headings for way in _WAYS):
        columns = find_columns(text, [_TARGET], [*_WAYS, RUN], remarks)
        runs = read_runs(columns, "target", [way.field for way in _WAYS], text.rows)
    else:
        runs = _runs_in_lines(find_columns(text, [_TARGET, _ERROR], [RUN, _DIRECTION], remarks))
    targets, readings = runs.in_order()
    if text.rows and "forward" not in readings and not text.problems.found:
        text.problems.add("expected forward readings, came none", text.heading_line)
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
        value = columns.needed(row, "error")
        written = columns.word(row, "direction").lower() if "direction" in columns else "forward"
        direction = _DIRECTIONS.get(written)
        if direction is None:
            columns.complain(
                row, "direction", f"expected forward or backward (+ or -), came {written!r}"
            )
        else:
            runs.add(row, target, direction, value, run)
    return runs


POSITIONING: Final = Format((axis_among(*LINEAR_LETTERS), REPEATABILITY), _read_positioning)
