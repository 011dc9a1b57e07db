"""Positioning by ISO 230-2: runs over target positions."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import Any, Final

from pydantic import Field

from app.api.methods.method import Method
from app.files.csv_columns import (
    LENGTH,
    POSITION,
    Columns,
    Named,
    Quantity,
    find_columns,
    match_columns,
    normal_heading,
)
from app.files.csv_measurements.formats import (
    REPEATABILITY,
    RUN,
    Body,
    Format,
    axis_among,
    positions_and_runs,
    read_runs,
)
from app.files.csv_measurements.formats import Runs as RunsOfTable
from app.files.delimited_text import DelimitedText
from app.geometry.components import LINEAR_LETTERS
from app.measurement.positioning import Positioning, evaluate_positioning
from app.pages.wording import message
from app.services.context import Context
from app.services.measurements import (
    Axis,
    MeasuredPositions,
    MeasurementAnswer,
    MeasurementRequest,
    Runs,
)
from app.thermal.machine import Machine


class PositioningRequest(
    MeasurementRequest,
    example={
        "axis": "x",
        "targets_mm": [0, 250, 500],
        "forward_um": [[0.0, 1.2, 2.0], [0.2, 1.0, 2.3]],
        "backward_um": [[-1.1, 0.3, 1.2], [-0.9, 0.1, 1.1]],
    },
):
    """Runs over target positions in both directions."""

    axis: Axis = Field(description="The axis that was measured")
    targets_mm: MeasuredPositions = Field(description="Target positions [mm]")
    forward_um: Runs = Field(
        description="Runs in the positive direction, each with measured minus target position "
        "at every target [µm]"
    )
    backward_um: Runs | None = Field(None, description="The same in the negative direction [µm]")


@dataclass(frozen=True, eq=False, kw_only=True)
class PositioningAnswer(MeasurementAnswer, Positioning):
    """ISO 230-2's figures of the axis (A, E, M, B, R in `figures`) and its displacement error."""


def _evaluate(_context: Context, _machine: Machine, body: PositioningRequest) -> Positioning:
    return evaluate_positioning(
        body.axis,
        body.targets_mm,
        body.forward_um,
        body.backward_um or (),
        repeatability_um=body.repeatability_um,
    )


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


def _runs_in_columns(text: DelimitedText, remarks: list[str]) -> RunsOfTable:
    """Read columns such as `forward_1_um`: a line for each target."""
    matches = [_NUMBERED.fullmatch(normal_heading(heading)) for heading in text.headings]
    numbered = {match["name"]: match for match in matches if match}
    things = [Named(name, LENGTH) for name in numbered]
    columns = find_columns(text, [_TARGET, *things], [], remarks)
    runs = RunsOfTable(columns)
    for row, target, _ in positions_and_runs(columns, "target", text.rows):
        for name, match in numbered.items():
            number = float(match["before"] or match["after"])
            value = columns.needed(row, name)
            runs.add(row, target, match["way"] or match["other"], value, number)
    return runs


def _runs_in_lines(columns: Columns) -> RunsOfTable:
    """Read a line for each reading; all are forward where no direction is stated."""
    runs = RunsOfTable(columns)
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


_FILE: Final = Format((axis_among(*LINEAR_LETTERS), REPEATABILITY), _read_positioning)


POSITIONING: Final = Method(
    name="positioning",
    title=message("positioning (ISO 230-2)"),
    summary="Positioning (ISO 230-2)",
    about="Evaluate runs over target positions; both directions are kept.",
    request=PositioningRequest,
    answer=PositioningAnswer,
    evaluate=_evaluate,
    file=_FILE,
)
