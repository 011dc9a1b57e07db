"""The straightness of an edge that the machine cut."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np
from pydantic import Field

from app.answer import fields_of
from app.api.methods.method import Method
from app.files.csv_columns import (
    LENGTH,
    POSITION,
    Named,
    find_columns,
)
from app.files.csv_comments import Statement
from app.files.csv_measurements.formats import (
    MEASURING_LINE,
    REPEATABILITY,
    RUN,
    TOOL_OFFSET,
    Body,
    Format,
    choice_among,
    flat_if_one,
    positions_and_runs,
)
from app.files.csv_measurements.formats import Runs as RunsOfTable
from app.files.delimited_text import DelimitedText
from app.geometry.components import parse_component
from app.measurement.machined_part import Comparison, MachinedPart, evaluate_machined_part
from app.measurement.stated_runs import as_straightness
from app.pages.wording import message
from app.services.context import Context
from app.services.measurements import MeasuredPositions, MeasurementAnswer, MeasurementRequest, Runs
from app.services.predictions import predict_part
from app.stated import Point
from app.thermal.machine import Machine


class MachinedPartRequest(
    MeasurementRequest,
    example={
        "component": "EXY",
        "positions_mm": [0, 50, 100, 150],
        "measured_um": [0.0, 1.2, 1.6, 0.7],
        "temperatures_c": {"x-middle": 24.1, "z-column": 27.3},
    },
):
    """Points along an edge that one axis machined, measured on a coordinate machine."""

    component: str = Field(
        description="Straightness component: EXY is an edge along y with deviations in x",
        examples=["EXY"],
    )
    positions_mm: MeasuredPositions = Field(description="Positions along the edge's axis [mm]")
    measured_um: Runs = Field(
        description="Actual minus nominal position of the edge, one pass or several [µm]"
    )
    line: Literal["least-squares", "end-points"] = Field(
        "least-squares", description="The line from which straightness counts"
    )
    measuring_line_mm: Point | None = Field(
        None, description="A point of the machine's path along the edge [mm]"
    )
    tool_offset_mm: Point = Field(
        (0.0, 0.0, 0.0), description="Tool offset with which it was cut [mm]"
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ComparisonAnswer(Comparison):
    """What the part says against what the model says."""

    model_version: int
    """Version of the model"""


@dataclass(frozen=True, eq=False, kw_only=True)
class MachinedPartAnswer(MeasurementAnswer, MachinedPart):
    """The straightness of the edge, and how it compares with the model."""

    comparison: ComparisonAnswer | None
    """With the active model at `temperatures_c`; null where there is no model"""


def _evaluate(context: Context, machine: Machine, body: MachinedPartRequest) -> MachinedPart:
    """Evaluate the edge, beside what the active model says of it at its temperatures."""
    predicted = None
    if body.temperatures_c:
        predicted = predict_part(
            context,
            machine.id,
            as_straightness(body.component),
            np.array(body.positions_mm, dtype=np.float64),
            body.temperatures_c,
            body.measuring_line_mm,
            body.tool_offset_mm,
        )
    evaluated = evaluate_machined_part(
        body.component,
        body.positions_mm,
        body.measured_um,
        None if predicted is None else predicted.predicted_um,
        line=body.line,
        measuring_line_mm=body.measuring_line_mm,
        tool_offset_mm=body.tool_offset_mm,
        repeatability_um=body.repeatability_um,
    )
    if predicted is None or evaluated.comparison is None:
        return evaluated
    compared = ComparisonAnswer(
        **fields_of(evaluated.comparison), model_version=predicted.model_version
    )
    return replace(evaluated, comparison=compared, further_notes=predicted.notes)


_POSITION: Final = Named("position", POSITION)


_MEASURED: Final = Named("measured", LENGTH, ("deviation", "error"))


def _read_machined_part(
    text: DelimitedText, statements: Mapping[str, Any], remarks: list[str]
) -> Body:
    columns = find_columns(text, [_POSITION, _MEASURED], [RUN], remarks)
    runs = RunsOfTable(columns)
    for row, at, run in positions_and_runs(columns, "position", text.rows):
        runs.add(row, at, "measured", columns.needed(row, "measured"), run)
    positions, readings = runs.in_order()
    measured = flat_if_one(readings.get("measured", [[]]))
    return {**statements, "positions_mm": positions, "measured_um": measured}


def _component_word(text: str) -> str:
    """Refuse what is no component; its name stays as written."""
    parse_component(text)
    return text


_FILE: Final = Format(
    (
        Statement(Named("component", None), 0, "component: EXY", True, _component_word),
        choice_among("line", "least-squares", "end-points"),
        MEASURING_LINE,
        TOOL_OFFSET,
        REPEATABILITY,
    ),
    _read_machined_part,
)


MACHINED_PART: Final = Method(
    name="machined-part",
    title=message("a machined edge"),
    summary="Straightness of a machined edge",
    about="Take the straightness of an edge, and compare it with the active model's prediction.",
    request=MachinedPartRequest,
    answer=MachinedPartAnswer,
    evaluate=_evaluate,
    file=_FILE,
)
