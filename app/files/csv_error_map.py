"""An error map from CSV: one row for each component and position.

    # label: Run #1
    # measured_at: 2026-03-01T06:00:00Z
    # temperature x-middle: 20.1
    component,position_mm,error_um,standard_error_um,backward_error_um
    EXX,0,0.0,0.2,
    EXX,50,1.2,0.3,

Other units have columns of their own (`error_urad`, `slope_um_per_m`, `value_um_per_m`
…, `standard_error_urad` …); those of other methods' files (`error_mm`, `error_arcsec` …)
are converted. Where there is only one column of values, it holds every
component in its own unit, and so with the columns `standard_error_um` (one standard
deviation), `backward_error_um` and `backward_standard_error_um`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np

from app.errors import list_names
from app.files.component_columns import COMPONENT_UNITS, UNIT_OF_COMPONENT, VALUE
from app.files.component_sheets import ComponentSheets, read_component_sheets
from app.files.csv_columns import (
    POSITION,
    Column,
    Columns,
    Named,
    by_field,
    has_column,
    match_columns,
)
from app.files.csv_comments import Header, read_comments
from app.files.delimited_text import (
    DelimitedText,
    Problems,
    Row,
    left_out,
    only_sheet,
    parse_delimited,
)
from app.files.read_body import ReadBody
from app.geometry.components import (
    COMPONENTS,
    Component,
    find_component,
    parse_component,
    unknown_component,
)
from app.measurement.stated_numbers import suspiciously_small
from app.thermal.error_map import impossible_error
from app.units import Unit

_COMPONENT: Final = Named("component", None)
_POSITION: Final = Named("position", POSITION)
_OWN_UNITS: Final = frozenset(str(unit) for unit in Unit)
"""In which the service has errors."""

_ERROR: Final = ""
_KINDS: Final = {
    _ERROR: "error",
    "standard_": "standard error",
    "backward_": "backward error",
    "backward_standard_": "backward standard error",
}
"""What stands before the names of the columns, and what they hold."""

_NAMES: Final = ("errors", "deviation", "deviations", "slope", "slopes", "value", "values")
_VALUES: Final = {
    kind: Named(
        f"{kind}error",
        VALUE,
        (f"{kind}errors",)
        if kind.endswith("standard_")
        else tuple(f"{kind}{name}" for name in _NAMES),
    )
    for kind in _KINDS
}


@dataclass(frozen=True, slots=True)
class _Table:
    """The columns `component` and `position`, and those of values by kind."""

    columns: Columns
    values: Mapping[str, Sequence[Column]]

    @property
    def text(self) -> DelimitedText:
        return self.columns.text


@dataclass(frozen=True, slots=True)
class _Point:
    """One row's numbers; `values` has one for each of `_KINDS`."""

    row: Row
    position_mm: float | None
    values: dict[str, float | None]


def parse_csv_error_map(sheets: Mapping[str, str], file: Path, header: Header) -> ReadBody:
    """Read an error map from the sheets of a file.

    Parameters
    ----------
    header
        What takes precedence over the file's own comment lines.

    Raises
    ------
    UnreadableFile
        With file, line and column of everything that is wrong, what was expected
        and what came.
    """
    problems = Problems(file)
    remarks: list[str] = []
    sheets_read = read_component_sheets(sheets, problems, remarks)
    if sheets_read is None:
        text = parse_delimited(only_sheet(sheets, file), problems)
        comments = read_comments(text, header, remarks)
        components = _read_components(text, remarks)
    else:
        comments = read_comments(sheets_read.header, header, remarks)
        components = _components_of_columns(sheets_read, remarks)
    problems.raise_if_any()
    return ReadBody(comments.state | {"components": components}, comments.machine, remarks)


def has_error_columns(text: DelimitedText) -> bool:
    """Say whether a table's columns hold components and their errors."""
    return has_column(text, _COMPONENT) and has_column(text, _VALUES[_ERROR])


def _read_components(text: DelimitedText, remarks: list[str]) -> list[dict[str, Any]]:
    table = _find_columns(text, remarks)
    points: dict[str, list[_Point]] = {}
    names: dict[str, str] = {}
    for row in text.rows:
        component = _component_of(table, row)
        if component is None:
            continue
        point = _read_point(table, row, component)
        if point is not None:
            points.setdefault(component.code, []).append(point)
            names.setdefault(component.code, table.columns.word(row, "component"))
    if not text.rows:
        text.problems.add("expected lines of values, got none")
    remarks.extend(_other_units(table, names))
    _expect_micrometres(table, points)
    return [
        made
        for code, points_of_code in points.items()
        if (made := _make_component(text, names[code], points_of_code)) is not None
    ]


def _components_of_columns(sheets: ComponentSheets, remarks: list[str]) -> list[dict[str, Any]]:
    """Put the cells of tables with a column for each component together."""
    points: dict[str, dict[object, _Point]] = {}
    names: dict[str, str] = {}
    for value in sheets.values:
        code = value.column.component.code
        place = (id(value.text), value.row.line, value.column.position)
        point = points.setdefault(code, {}).setdefault(
            place, _Point(value.row, value.position_mm, dict.fromkeys(_KINDS))
        )
        point.values[value.column.kind] = value.value
        names.setdefault(code, value.column.name)
    if not points:
        sheets.header.problems.add("expected lines of values, got none")
    for code, of_places in points.items():
        for point in of_places.values():
            if point.values[_ERROR] is None:
                message = f"expected the error of {code} beside its other values, got none"
                sheets.header.problems.add(message, point.row.line)
    _refuse_millimetres(
        "the columns without another unit",
        [
            one.value
            for one in sheets.values
            if one.column.unit in (UNIT_OF_COMPONENT, Unit.UM)
            and not one.column.kind
            and one.column.component.unit is Unit.UM
        ],
        sheets.header.problems,
        "Write [mm] into the headings",
    )
    return [
        table
        for code, of_places in points.items()
        if (table := _make_component(sheets.header, names[code], list(of_places.values())))
        is not None
    ]


def _refuse_millimetres(
    heading: str, lengths: Sequence[float], problems: Problems, remedy: str
) -> None:
    """Refuse lengths, said to be in µm, that are all so small that they are in mm."""
    for sentence in suspiciously_small(heading, np.array(lengths)) if lengths else ():
        problems.add(
            f"{sentence} {remedy} if they are; a map that truly is so small can be given as JSON"
        )


def _expect_micrometres(table: _Table, points: Mapping[str, Sequence[_Point]]) -> None:
    """Refuse a map whose lengths, said to be in µm, are all so small that they are in mm."""
    plain = [
        column for column in table.values[_ERROR] if column.unit in (UNIT_OF_COMPONENT, Unit.UM)
    ]
    lengths = [
        value
        for code, points_of_code in points.items()
        if COMPONENTS[code].unit is Unit.UM
        for point in points_of_code
        if (value := point.values[_ERROR]) is not None
    ]
    if plain:
        _refuse_millimetres(
            table.text.headings[plain[0].index],
            lengths,
            table.text.problems,
            "Call the column error_mm",
        )


def _find_columns(text: DelimitedText, remarks: list[str]) -> _Table:
    """Tell the columns apart by their names; several may hold values, each in its unit."""
    matches = match_columns(text, (_COMPONENT, _POSITION, *_VALUES.values()))
    columns_by_field = by_field(
        text, [match for match in matches if match.thing in (_COMPONENT, _POSITION)]
    )
    values = {kind: [o for o in matches if o.thing is thing] for kind, thing in _VALUES.items()}
    if "component" not in columns_by_field or not values[_ERROR]:
        text.problems.add(
            "expected the columns component, position_mm and error_um (or error_mm, error_urad, "
            f"slope_um_per_m, value_um_per_m …), got {', '.join(text.headings)}",
            text.heading_line,
        )
    text.problems.raise_if_any()
    read = {match.index for match in matches}
    unread = [heading for i, heading in enumerate(text.headings) if i not in read]
    if unread:
        remarks.append(left_out(unread))
    return _Table(Columns(text, columns_by_field), values)


def _is_converted(column: Column) -> bool:
    """Say whether a column's unit is another than those of components."""
    return column.unit != UNIT_OF_COMPONENT and column.unit not in _OWN_UNITS


def _component_of(table: _Table, row: Row) -> Component | None:
    name = table.columns.word(row, "component")
    match = find_component(name)
    if match is None:
        table.columns.complain(row, "component", lambda: unknown_component(name))
        return None
    return match[0]


def _read_point(table: _Table, row: Row, component: Component) -> _Point | None:
    problems = table.text.problems
    before = problems.number
    position_mm = table.columns.number(row, "position")
    values = {kind: _read_value(table, row, kind, component) for kind in _KINDS}
    if problems.number > before:
        return None
    if values[_ERROR] is None:
        forward = table.values[_ERROR]
        column = (*_columns_for(forward, component), forward[0])[0]
        table.text.complain(
            row,
            column.index,
            f"expected the error of {component.code} in {component.unit.symbol}, got none",
        )
        return None
    if (position_mm is not None) != component.is_table:
        _complain_of_position(table.columns, row, component)
        return None
    return _Point(row, position_mm, values)


def _complain_of_position(columns: Columns, row: Row, component: Component) -> None:
    if "position" not in columns:
        columns.text.problems.add_once(
            f"expected a column position_mm for {component.code}, "
            f"got {list_names(columns.text.headings)}",
            columns.text.heading_line,
        )
    elif component.is_table:
        columns.complain(
            row, "position", f"expected a position of {component.code} in mm, got none"
        )
    else:
        columns.complain(
            row,
            "position",
            f"expected nothing, as {component.code} is one value without position, "
            f"got {columns.word(row, 'position')!r}",
        )


def _columns_for(columns: Sequence[Column], component: Component) -> Sequence[Column]:
    """Find the columns of a component's unit; the only column serves every unit."""
    fitting = [column for column in columns if component.unit in COMPONENT_UNITS[column.unit]]
    if not fitting and len(columns) == 1 and not _is_converted(columns[0]):
        return columns
    return fitting


def _read_value(table: _Table, row: Row, kind: str, component: Component) -> float | None:
    """Read the one value of a kind in a row, and complain where it is in another unit's column."""
    text, of_kind = table.text, table.values[kind]
    fitting = _columns_for(of_kind, component)
    filled = [column for column in of_kind if row.cells[column.index]]
    value = None
    for i, column in enumerate(filled):
        got = row.cells[column.index]
        if kind.startswith("backward_") and not component.is_table:
            text.complain(
                row,
                column.index,
                f"expected nothing, as {component.code} has no direction of approach, got {got!r}",
            )
            continue
        if column in fitting and i == 0:
            is_converted = _is_converted(column)
            symbol = column.symbol if is_converted else component.unit.symbol
            value = text.number(row, column.index, symbol)
            if value is not None and is_converted:
                value = VALUE.convert(value, column.unit)
            impossible = "" if value is None else impossible_error(component, value)
            if impossible:
                text.complain(row, column.index, impossible)
            elif value is not None and value < 0 and kind.endswith("standard_"):
                text.complain(
                    row,
                    column.index,
                    f"expected a standard error of {component.code} in {component.unit.symbol}, "
                    f"which is not negative, got {got!r}",
                )
            continue
        names = [text.headings[c.index] for c in fitting] or [f"{kind}error_{component.unit}"]
        text.complain(
            row,
            column.index,
            f"expected {component.code} in {component.unit.symbol} once, in the column "
            f"{' or '.join(names)}, got {got!r}",
        )
    return value


def _other_units(table: _Table, names: Mapping[str, str]) -> Iterator[str]:
    """Say which components were read in a unit that the only column's name does not state."""
    forward = table.values[_ERROR]
    if len(forward) > 1:
        return
    only = forward[0]
    for unit in Unit:
        codes = [code for code, name in names.items() if parse_component(name)[0].unit is unit]
        if codes and unit not in COMPONENT_UNITS[only.unit]:
            heading = table.text.headings[only.index]
            yield f"values of {list_names(codes)} in {heading} are read in {unit.symbol}"


def _make_component(
    text: DelimitedText, name: str, points: Sequence[_Point]
) -> dict[str, Any] | None:
    """Put a component's rows in order of position."""
    component = parse_component(name)[0]
    ordered = sorted(points, key=lambda p: (p.position_mm or 0.0, p.row.line))
    before = text.problems.number
    for earlier, later in pairwise(ordered):
        if earlier.position_mm == later.position_mm:
            at = "" if later.position_mm is None else f" at {later.position_mm:g} mm"
            text.problems.add(
                f"expected one value of {component.code}{at}, got another one in line "
                f"{earlier.row.line}",
                later.row.line,
            )
    for kind, words in _KINDS.items():
        _complain_of_gaps(text, component, kind, words, ordered)
    if text.problems.number > before:
        return None
    return {"component": name, **_numbers(component, ordered)}


def _complain_of_gaps(
    text: DelimitedText, component: Component, kind: str, words: str, points: Sequence[_Point]
) -> None:
    for point in points:
        if (point.values[kind] is None) != (points[0].values[kind] is None):
            text.problems.add(
                f"expected a {words} of {component.code} in every line or in none, "
                f"unlike line {points[0].row.line}",
                point.row.line,
            )
            break


def _numbers(component: Component, ordered: Sequence[_Point]) -> dict[str, Any]:
    """Give a component's numbers under the names that the service has for them."""
    names = {
        _ERROR: component.input_field,
        "standard_": component.standard_error_field,
        "backward_": f"backward_{component.input_field}",
        "backward_standard_": f"backward_{component.standard_error_field}",
    }
    present = {kind: name for kind, name in names.items() if ordered[0].values[kind] is not None}
    if not component.is_table:
        return {name: ordered[0].values[kind] for kind, name in present.items()}
    return {
        "positions_mm": [p.position_mm for p in ordered],
        **{name: [p.values[kind] for p in ordered] for kind, name in present.items()},
    }
