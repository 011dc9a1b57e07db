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

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from app.api.field_errors import field_error
from app.api.schemas.error_maps import ComponentSchema, ErrorMapSchema
from app.cli.csv_comments import Stated, read_comments
from app.cli.csv_measurements.quantities import (
    LENGTH,
    POSITION,
    SMALL_ANGLE,
    Named,
    Quantity,
    normal_heading,
    symbol_of,
)
from app.cli.delimited_text import (
    DelimitedText,
    Problems,
    Row,
    left_out,
    read_delimited,
)
from app.errors import InvalidContent, UnknownComponent, list_names
from app.geometry.components import COMPONENTS, Component, parse_component
from app.measurement.stated_numbers import LARGEST_UM, suspiciously_small
from app.units import Unit

_VALUE_COLUMN: Final = re.compile(
    r"(?P<what>(backward_)?(standard_(?=error))?)"
    r"(errors?|slopes?|values?)(_(?P<unit>.+))?"
)
_POSITION: Final = Named("position", POSITION)
_SLOPE_OF_ANGLE: Final = Quantity("urad_per_m", {"urad_per_m": Decimal(1)})
_OWN_UNITS: Final = frozenset(str(unit) for unit in Unit)
"""In which the service has errors."""

_HOLDS: Final[Mapping[str, tuple[Quantity, Sequence[Unit]]]] = {
    **dict.fromkeys(LENGTH.factors, (LENGTH, (Unit.UM,))),
    **dict.fromkeys(SMALL_ANGLE.factors, (SMALL_ANGLE, (Unit.URAD, Unit.UM_PER_M))),
    "urad": (SMALL_ANGLE, (Unit.URAD,)),
    **dict.fromkeys(("um_per_m", "mm_per_m"), (SMALL_ANGLE, (Unit.UM_PER_M,))),
    "urad_per_m": (_SLOPE_OF_ANGLE, (Unit.URAD_PER_M,)),
}
"""Unit of a column to what it is, and whose components' unit it can be converted to."""

_ERROR: Final = ""
_KINDS: Final = {
    _ERROR: "error",
    "standard_": "standard error",
    "backward_": "backward error",
    "backward_standard_": "backward standard error",
}
"""What stands before the names of the columns, and what they hold."""


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

    @property
    def is_converted(self) -> bool:
        """Whether its unit is another than those of components."""
        return self.unit is not None and self.unit not in _OWN_UNITS

    def holds(self, component: Component) -> bool:
        """Whether its unit can be a component's."""
        return self.unit is not None and component.unit in _HOLDS[self.unit][1]

    def symbol(self, component: Component) -> str:
        """Name the unit in which it states a component."""
        return symbol_of(str(self.unit)) if self.is_converted else component.unit.symbol

    def converted(self, value: float) -> float:
        """Turn a number of it to the unit of the component that it holds."""
        if self.unit is None or not self.is_converted:
            return value
        return _HOLDS[self.unit][0].convert(value, self.unit)


@dataclass(frozen=True, slots=True)
class _Columns:
    component: int
    position: int | None
    position_unit: str
    values: Mapping[str, Sequence[_ValueColumn]]


@dataclass(frozen=True, slots=True)
class _Point:
    """One row's numbers; `values` has one for each of `_KINDS`."""

    row: Row
    position_mm: float | None
    values: Mapping[str, float | None]


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
    _expect_micrometres(text, columns, points)
    return [
        made
        for code, found in points.items()
        if (made := _make_component(text, names[code], found)) is not None
    ]


def _expect_micrometres(
    text: DelimitedText, columns: _Columns, points: Mapping[str, Sequence[_Point]]
) -> None:
    """Refuse a map whose lengths, said to be in µm, are all so small that they are in mm."""
    plain = [column for column in columns.values[_ERROR] if column.unit in (None, Unit.UM)]
    lengths = [
        value
        for code, found in points.items()
        if COMPONENTS[code].unit is Unit.UM
        for point in found
        if (value := point.values[_ERROR]) is not None
    ]
    if plain and lengths:
        for sentence in suspiciously_small(text.headings[plain[0].index], np.array(lengths)):
            text.problems.add(
                f"{sentence} Call the column error_mm if they are; a map that truly is so small "
                "can be given as JSON"
            )


def _find_columns(text: DelimitedText, remarks: list[str]) -> _Columns:
    """Tell the columns apart by their names."""
    plain = [normal_heading(heading) for heading in text.headings]
    values = {
        i: found
        for i, name in enumerate(plain)
        if (found := _VALUE_COLUMN.fullmatch(name))
        and (not found["unit"] or found["unit"] in _HOLDS)
    }
    by_kind = {
        kind: [_ValueColumn(i, v["unit"]) for i, v in values.items() if v["what"] == kind]
        for kind in _KINDS
    }
    if "component" not in plain or not by_kind[_ERROR]:
        text.problems.add(
            "expected the columns component, position_mm and error_um (or error_mm, error_urad, "
            f"slope_um_per_m, value_um_per_m …), came {', '.join(text.headings)}",
            text.heading_line,
        )
        text.problems.raise_if_any()
    placed = {i: unit for i, name in enumerate(plain) if (unit := _POSITION.unit_in(name))}
    position = next((i for i, unit in placed.items() if _POSITION.knows(unit)), None)
    known = {plain.index("component"), position, *values}
    unread = [heading for i, heading in enumerate(text.headings) if i not in known]
    if unread:
        remarks.append(left_out(unread))
    unit = POSITION.unit if position is None else placed[position]
    return _Columns(plain.index("component"), position, unit, by_kind)


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
    position_mm = _read_position(text, row, columns)
    values = {kind: _read_value(text, row, columns, kind, component) for kind in _KINDS}
    if len(text.problems.found) > before:
        return None
    if values[_ERROR] is None:
        forward = columns.values[_ERROR]
        column = (*_columns_for(forward, component), forward[0])[0]
        text.complain(
            row,
            column.index,
            f"expected the error of {component.code} in {component.unit.symbol}, came none",
        )
        return None
    if (position_mm is not None) != component.is_table:
        _complain_of_position(text, row, columns.position, component)
        return None
    return _Point(row, position_mm, values)


def _read_position(text: DelimitedText, row: Row, columns: _Columns) -> float | None:
    """Read a position in mm; None where there is none."""
    if columns.position is None:
        return None
    found = text.number(row, columns.position, symbol_of(columns.position_unit))
    return None if found is None else POSITION.convert(found, columns.position_unit)


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
    fitting = [column for column in columns if column.holds(component)]
    if not fitting and len(columns) == 1 and not columns[0].is_converted:
        return columns
    return fitting


def _read_value(
    text: DelimitedText, row: Row, columns: _Columns, kind: str, component: Component
) -> float | None:
    """Read the one value of a kind in a row, and complain where it is in another unit's column."""
    of_kind = columns.values[kind]
    fitting = _columns_for(of_kind, component)
    filled = [column for column in of_kind if row.cells[column.index]]
    value = None
    for i, column in enumerate(filled):
        came = row.cells[column.index]
        if kind.startswith("backward_") and not component.is_table:
            text.complain(
                row,
                column.index,
                f"expected nothing, as {component.code} has no direction of approach, "
                f"came {came!r}",
            )
            continue
        if column in fitting and i == 0:
            value = text.number(row, column.index, column.symbol(component))
            value = None if value is None else column.converted(value)
            if value is not None and abs(value) > LARGEST_UM:
                text.complain(
                    row,
                    column.index,
                    f"expected errors within ±{LARGEST_UM:g} {component.unit.symbol}, "
                    f"came {value:g} {component.unit.symbol}: is it in another unit, or is the "
                    "nominal position still in it?",
                )
            elif value is not None and value < 0 and kind.endswith("standard_"):
                text.complain(
                    row,
                    column.index,
                    f"expected a standard error of {component.code} in {component.unit.symbol}, "
                    f"which is not negative, came {came!r}",
                )
            continue
        names = [text.headings[c.index] for c in fitting] or [f"{kind}error_{component.unit}"]
        text.complain(
            row,
            column.index,
            f"expected {component.code} in {component.unit.symbol} once, in the column "
            f"{' or '.join(names)}, came {came!r}",
        )
    return value


def _other_units(text: DelimitedText, columns: _Columns, names: Mapping[str, str]) -> Iterator[str]:
    """Say which components were read in another unit than the only column's name says."""
    forward = columns.values[_ERROR]
    if len(forward) > 1:
        return
    only = forward[0]
    for unit in Unit:
        codes = [code for code, name in names.items() if parse_component(name)[0].unit is unit]
        if codes and only.unit is not None and unit not in _HOLDS[only.unit][1]:
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
    for kind, words in _KINDS.items():
        _complain_of_gaps(text, component, kind, words, ordered)
    if len(text.problems.found) > before:
        return None
    return ComponentSchema(component=name, **_numbers(component, ordered))


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
    stated = {kind: name for kind, name in names.items() if ordered[0].values[kind] is not None}
    if not component.is_table:
        return {name: ordered[0].values[kind] for kind, name in stated.items()}
    return {
        "positions_mm": [p.position_mm for p in ordered],
        **{name: [p.values[kind] for p in ordered] for kind, name in stated.items()},
    }


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
