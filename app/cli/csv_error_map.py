"""An error map from CSV: one row for each component and position.

    # label: Run #1
    # measured_at: 2026-03-01T06:00:00Z
    # temperature x-middle: 20.1
    component,position_mm,error_um,backward_error_um
    EXX,0,0.0,
    EXX,50,1.2,

Other units have columns of their own (`error_urad`, `slope_um_per_m`, `value_um_per_m`
…). Where there is only one column of values, it holds every component in its own unit.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from app.api.error_responses import field_error
from app.api.schemas.error_maps import ComponentSchema, ErrorMapSchema
from app.cli.csv_comments import Stated, read_comments
from app.cli.delimited_text import (
    DelimitedText,
    Problems,
    Row,
    left_out,
    plain_heading,
    read_delimited,
)
from app.errors import InvalidContent, UnknownComponent, list_names
from app.geometry.components import Component, parse_component
from app.units import Unit

_VALUE_COLUMN: Final = re.compile(
    r"(?P<backward>backward_)?(errors?|slopes?|values?)(_(?P<unit>um|urad|um_per_m|urad_per_m))?"
)


@dataclass(frozen=True, slots=True)
class CsvErrorMap:
    """A map as it is to be sent, the machine that the file names, and what was noticed."""

    error_map: ErrorMapSchema
    machine: str | None
    remarks: Sequence[str]


@dataclass(frozen=True, slots=True)
class _ValueColumn:
    index: int
    unit: str | None


@dataclass(frozen=True, slots=True)
class _Columns:
    component: int
    position: int | None
    forward: Sequence[_ValueColumn]
    backward: Sequence[_ValueColumn]


@dataclass(frozen=True, slots=True)
class _Point:
    """One row's numbers."""

    row: Row
    position_mm: float | None
    error: float
    backward_error: float | None


def read_csv_error_map(file: Path, stated: Stated) -> CsvErrorMap:
    """Read an error map and check all of it.

    Parameters
    ----------
    file
        CSV, see above.
    stated
        What goes before the file's own comment lines.

    Raises
    ------
    UnreadableFile
        With file, line and column of everything that is wrong, what was expected
        and what came.
    """
    problems = Problems(file)
    text = read_delimited(file, problems)
    remarks: list[str] = []
    facts = read_comments(text, stated, remarks)
    components = _read_components(text, remarks)
    problems.raise_if_any()
    machine = facts.pop("machine", None)
    error_map = _checked_map(facts | {"components": components}, problems)
    return CsvErrorMap(error_map, machine, remarks)


def _read_components(text: DelimitedText, remarks: list[str]) -> list[ComponentSchema]:
    columns = _find_columns(text, remarks)
    points: dict[str, list[_Point]] = {}
    names: dict[str, str] = {}
    for row in text.rows:
        component = _component_of(text, row, columns)
        if component is None:
            continue
        point = _read_point(text, row, columns, component)
        if point is not None:
            points.setdefault(component.code, []).append(point)
            names.setdefault(component.code, row.cells[columns.component])
    if not text.rows:
        text.problems.add("expected lines of values, came none")
    remarks.extend(_other_units(text, columns, names))
    return [
        made
        for code, found in points.items()
        if (made := _make_component(text, names[code], found)) is not None
    ]


def _find_columns(text: DelimitedText, remarks: list[str]) -> _Columns:
    """Tell the columns apart by their names."""
    plain = [plain_heading(heading) for heading in text.headings]
    values = {i: found for i, name in enumerate(plain) if (found := _VALUE_COLUMN.fullmatch(name))}
    forward = [_ValueColumn(i, v["unit"]) for i, v in values.items() if not v["backward"]]
    backward = [_ValueColumn(i, v["unit"]) for i, v in values.items() if v["backward"]]
    if "component" not in plain or not forward:
        text.problems.add(
            "expected the columns component, position_mm and error_um (or error_urad, "
            f"slope_um_per_m, value_um_per_m …), came {', '.join(text.headings)}",
            text.heading_line,
        )
        text.problems.raise_if_any()
    position = plain.index("position_mm") if "position_mm" in plain else None
    known = {plain.index("component"), position, *values}
    unread = [heading for i, heading in enumerate(text.headings) if i not in known]
    if unread:
        remarks.append(left_out(unread))
    return _Columns(plain.index("component"), position, forward, backward)


def _component_of(text: DelimitedText, row: Row, columns: _Columns) -> Component | None:
    try:
        return parse_component(row.cells[columns.component])[0]
    except UnknownComponent as error:
        text.complain(row, columns.component, error.detail)
        return None


def _read_point(
    text: DelimitedText, row: Row, columns: _Columns, component: Component
) -> _Point | None:
    before = len(text.problems.found)
    position_mm = None if columns.position is None else text.number(row, columns.position, "mm")
    error = _read_value(text, row, columns.forward, component)
    backward_error = _read_value(text, row, columns.backward, component)
    if len(text.problems.found) > before:
        return None
    if error is None:
        column = (*_columns_for(columns.forward, component), columns.forward[0])[0]
        text.complain(
            row,
            column.index,
            f"expected the error of {component.code} in {component.unit.symbol}, came none",
        )
        return None
    if (position_mm is not None) != component.is_table:
        _complain_of_position(text, row, columns.position, component)
        return None
    return _Point(row, position_mm, error, backward_error)


def _complain_of_position(
    text: DelimitedText, row: Row, column: int | None, component: Component
) -> None:
    if column is None:
        text.problems.add(
            f"expected a column position_mm for {component.code}, came none", text.heading_line
        )
    elif component.is_table:
        text.complain(row, column, f"expected a position of {component.code} in mm, came none")
    else:
        text.complain(
            row,
            column,
            f"expected nothing, as {component.code} is one value without position, "
            f"came {row.cells[column]!r}",
        )


def _columns_for(columns: Sequence[_ValueColumn], component: Component) -> Sequence[_ValueColumn]:
    """Find the columns of a component's unit; the only column serves every unit."""
    fitting = [column for column in columns if column.unit == component.unit]
    return fitting or (columns if len(columns) == 1 else [])


def _read_value(
    text: DelimitedText, row: Row, columns: Sequence[_ValueColumn], component: Component
) -> float | None:
    """Read the one value of a row, and complain where it stands in another unit's column."""
    fitting = _columns_for(columns, component)
    filled = [column for column in columns if row.cells[column.index]]
    value = None
    for i, column in enumerate(filled):
        if column in fitting and i == 0:
            value = text.number(row, column.index, component.unit.symbol)
            continue
        names = [text.headings[c.index] for c in fitting] or [f"error_{component.unit}"]
        text.complain(
            row,
            column.index,
            f"expected {component.code} in {component.unit.symbol} once, in the column "
            f"{' or '.join(names)}, came {row.cells[column.index]!r}",
        )
    return value


def _other_units(text: DelimitedText, columns: _Columns, names: Mapping[str, str]) -> Iterator[str]:
    """Say which components were read in another unit than the only column's name says."""
    if len(columns.forward) > 1:
        return
    only = columns.forward[0]
    for unit in Unit:
        codes = [code for code, name in names.items() if parse_component(name)[0].unit is unit]
        if codes and only.unit is not None and unit != only.unit:
            heading = text.headings[only.index]
            yield f"values of {list_names(codes)} in {heading} are read in {unit.symbol}"


def _make_component(
    text: DelimitedText, name: str, points: Sequence[_Point]
) -> ComponentSchema | None:
    """Put a component's rows in order of position."""
    component = parse_component(name)[0]
    ordered = sorted(points, key=lambda p: (p.position_mm or 0.0, p.row.line))
    before = len(text.problems.found)
    for earlier, later in pairwise(ordered):
        if earlier.position_mm == later.position_mm:
            at = "" if later.position_mm is None else f" at {later.position_mm:g} mm"
            text.problems.add(
                f"expected {component.code}{at} once, came again after line {earlier.row.line}",
                later.row.line,
            )
    for point in ordered:
        if (point.backward_error is None) != (ordered[0].backward_error is None):
            text.problems.add(
                f"expected a backward error of {component.code} in every line or in none, "
                f"unlike line {ordered[0].row.line}",
                point.row.line,
            )
            break
    if len(text.problems.found) > before:
        return None
    return ComponentSchema(component=name, **_numbers(component, ordered))


def _numbers(component: Component, ordered: Sequence[_Point]) -> dict[str, Any]:
    if not component.is_table:
        return {component.input_field: ordered[0].error}
    numbers: dict[str, Any] = {
        "positions_mm": [p.position_mm for p in ordered],
        component.input_field: [p.error for p in ordered],
    }
    if ordered[0].backward_error is not None:
        numbers[f"backward_{component.input_field}"] = [p.backward_error for p in ordered]
    return numbers


def _checked_map(facts: Mapping[str, Any], problems: Problems) -> ErrorMapSchema:
    """Make the map as the service would, so that what it would refuse is known here."""
    try:
        error_map = ErrorMapSchema.model_validate(facts)
        error_map.to_error_map()
    except ValidationError as error:
        for found in map(field_error, error.errors()):
            problems.add(f"{found.field}: {found.message}")
    except InvalidContent as error:
        problems.add(error.detail)
    problems.raise_if_any()
    return error_map
