"""Tables with a column for each component, as calibration sheets have them.

    Position [mm]; EXX [µm]; EYX [µm]; EBX [µrad]; EXX ↓ [µm]
    0;             0;        0;        0;          -0,4

Several such blocks may stand below or beside each other, or on sheets of their own. A component
stands over the nearest column of positions at its left. A value without position, such as
squareness, has a column, or a line of its own: `SXY; 3,4; µm/m`.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from itertools import zip_longest
from typing import Final

from app.decimal_text import read_number
from app.errors import list_names
from app.files.csv_columns import (
    LENGTH,
    POSITION,
    SMALL_ANGLE,
    Column,
    Named,
    Quantity,
    name_after,
    named,
    normal_heading,
)
from app.files.delimited_text import DelimitedText, Row
from app.geometry.components import (
    LINEAR_LETTERS,
    Component,
    find_component,
    unsure_component,
)
from app.thermal.error_map import impossible_error
from app.units import Unit

UNIT_OF_COMPONENT: Final = ""
"""Stands for the unit of a column that states none: each component's own."""

_SLOPE_OF_ANGLE: Final = "urad_per_m"

VALUE: Final = Quantity(
    "um",
    {**LENGTH.factors, **SMALL_ANGLE.factors, _SLOPE_OF_ANGLE: Decimal(1)},
    assumed=UNIT_OF_COMPONENT,
)
"""Of whatever component: a unit of lengths is none of angles, and so each converts in one way."""

COMPONENT_UNITS: Final[Mapping[str, Sequence[Unit]]] = {
    **dict.fromkeys(LENGTH.factors, (Unit.UM,)),
    **dict.fromkeys(SMALL_ANGLE.factors, (Unit.URAD, Unit.UM_PER_M)),
    _SLOPE_OF_ANGLE: (Unit.URAD_PER_M,),
    UNIT_OF_COMPONENT: (),
}
"""Unit of a column to the units of the components that it can be converted to."""

_AXIS_FORMS: Final = ("{}", "{}_position", "position_{}")
_POSITION: Final = Named(
    "position",
    POSITION,
    (
        *("pos", "target", "target_position", "nominal", "nominal_position"),
        *(form.format(axis) for axis in LINEAR_LETTERS for form in _AXIS_FORMS),
    ),
)
_AXIS: Final = re.compile(r"(?:position_)?([xyz])(?:_position)?(?:_[a-z]+)?")

_BACKWARD: Final = frozenset(
    {"backward", "down", "negative", "-", "\N{MINUS SIGN}", "rev", "reverse"}
)
_FORWARD: Final = frozenset({"forward", "up", "positive", "+"})
_STANDARD: Final = frozenset({"standard", "std", "s", "u", "sigma"})
_FILLING: Final = frozenset({"error", "errors", "deviation", "deviations"})


@dataclass(frozen=True, slots=True)
class ComponentColumn:
    """Where a component's values stand.

    Parameters
    ----------
    name
        The component as it is written, which has its sign.
    is_forward, is_backward, is_standard_error
        What the heading says of the values.
    unit
        That of the heading, `OWN` where it states none.
    position
        Index of the column of their positions; None where there is none at the left.
    """

    index: int
    name: str
    component: Component
    is_forward: bool
    is_backward: bool
    is_standard_error: bool
    unit: str
    position: int | None = None

    @property
    def kind(self) -> str:
        """What stands before `error` in the name of such a column where components have lines."""
        return "backward_" * self.is_backward + "standard_" * self.is_standard_error


@dataclass(frozen=True, slots=True)
class ComponentValue:
    """One cell: which component's, where, how large [its own unit], and in which line."""

    text: DelimitedText
    row: Row
    column: ComponentColumn
    position_mm: float | None
    value: float

    def beside(self, name: str) -> str:
        """Read the word in its line under another heading; empty where there is none."""
        headings = [heading.lower() for heading in self.text.headings]
        index = headings.index(name) if name in headings else len(self.row.cells)
        return self.row.cells[index] if index < len(self.row.cells) else ""


@dataclass(slots=True)
class _Block:
    """What a line of column names says of the lines below it."""

    text: DelimitedText
    columns: Sequence[ComponentColumn]
    positions: Mapping[int, Column]


@dataclass(slots=True)
class ComponentTables:
    """What a sheet holds: values of components, and lines that are none.

    Parameters
    ----------
    values
        In the order of the lines.
    others
        Lines that are no values of components.
    """

    values: list[ComponentValue] = field(default_factory=list)
    others: list[Row] = field(default_factory=list)


def component_headings(text: DelimitedText) -> frozenset[str]:
    """Give the names of all columns in lines that name components; none where no line does."""
    rows = filter(_is_heading, _lines(text))
    return frozenset(normal_heading(cell) for row in rows for cell in row.cells if cell)


def read_component_tables(
    text: DelimitedText, remarks: list[str], beside: Collection[str] = ()
) -> ComponentTables:
    """Read all blocks of a sheet; what is wrong is noted in its problems.

    Parameters
    ----------
    text
        The sheet, whose first line may be anything.
    remarks
        Takes up which columns are not read, and which units are the components' own.
    beside
        Columns that somebody reads beside the components, by their names or first words.
    """
    tables = ComponentTables()
    block: _Block | None = None
    rows = list(_lines(text))
    for row, below in zip_longest(rows, rows[1:]):
        if _is_heading(row):
            heading = _with_units(row, below) if below and _is_of_units(below) else row
            block = _block(text, heading, remarks, beside)
        elif block is not None and _is_of_units(row):
            continue
        elif (alone := _single_value(text, row)) is not None:
            tables.values.append(alone)
        elif block is None or (sum(map(bool, row.cells)) == 1 and read_number(_first(row)) is None):
            block = None
            tables.others.append(row)
        else:
            tables.values += _values(block, row)
    return tables


def _lines(text: DelimitedText) -> Iterator[Row]:
    yield Row(text.heading_line, [*text.headings])
    yield from text.rows


def _first(row: Row) -> str:
    return next((cell for cell in row.cells if cell), "")


def _is_heading(row: Row) -> bool:
    """Whether a line names components, and their positions where it names anything else."""
    cells = [cell for cell in row.cells if cell]
    if len(cells) < 2 or any(read_number(cell) is not None for cell in cells):
        return False
    components = [cell for cell in cells if component_column(0, cell) is not None]
    has_positions = any(_POSITION.unit_in(cell) is not None for cell in cells)
    return bool(components) and (has_positions or len(components) == len(cells))


def _is_of_units(row: Row) -> bool:
    """Whether a line says the units of the columns that are named above it."""
    cells = [normal_heading(cell) for cell in row.cells if cell]
    return bool(cells) and all(cell in VALUE.factors or cell in POSITION.factors for cell in cells)


def _with_units(row: Row, units: Row) -> Row:
    cells = zip_longest(row.cells, (unit.strip("[]()") for unit in units.cells), fillvalue="")
    return Row(row.line, [f"{name} [{unit}]" if unit else name for name, unit in cells])


def _component(word: str) -> Component | None:
    match = find_component(word)
    return None if match is None else match[0]


def component_column(index: int, heading: str) -> ComponentColumn | None:
    """Read a heading that names a component; None where it names none.

    >>> column = component_column(1, "EXX ↓ [µm]")
    >>> column.component.code, column.is_backward, column.unit
    ('EXX', True, 'um')
    >>> component_column(0, "Position [mm]") is None
    True
    """
    for word in heading.replace("[", " [").split():
        for name in dict.fromkeys((word, word.strip("()+-\N{MINUS SIGN}↑↓"), *_within(word))):
            component = _component(name) if len(name) >= _SHORTEST else None
            if component is not None:
                rest = normal_heading(heading.replace(name, " ", 1)).split("_")
                words = {part for part in rest if part}
                unit = "_".join(
                    part
                    for part in rest
                    if part and part not in _BACKWARD | _FORWARD | _STANDARD | _FILLING
                )
                return ComponentColumn(
                    index,
                    name,
                    component,
                    bool(words & _FORWARD),
                    bool(words & _BACKWARD),
                    bool(words & _STANDARD),
                    unit,
                )
    return None


_SHORTEST: Final = 3


def _within(word: str) -> Sequence[str]:
    """Names in a word: `EXX` of `EXX_um`, and of `u(EXX)`."""
    inside = re.fullmatch(r"[us]\((.+)\)", word)
    return (inside[1],) if inside else (word.partition("_")[0], word.rpartition("_")[0])


def _block(text: DelimitedText, row: Row, remarks: list[str], beside: Collection[str]) -> _Block:
    """Tell the columns of a block apart; what is wrong with a heading is noted."""
    block_text = replace(text, headings=row.cells, heading_line=row.line)
    positions: dict[int, Column] = {}
    columns: list[ComponentColumn] = []
    unread: list[str] = []
    nearest: int | None = None
    for index, heading in enumerate(row.cells):
        column = component_column(index, heading) if heading else None
        position = named([_POSITION], heading)
        if column is not None:
            columns.append(replace(column, position=nearest))
        elif position is not None:
            nearest = index
            positions[index] = Column(*position, index)
        elif _POSITION.fails_by_unit(heading):
            nearest = index
            complaint = _POSITION.complaint(_POSITION.unit_in(heading) or "")
            text.problems.add(complaint, row.line, block_text.place(index))
        elif unsure := unsure_component(heading):
            text.problems.add(f"{unsure}, got {heading!r}", row.line, block_text.place(index))
        elif heading and not any(heading.lower() == n or name_after(n, heading) for n in beside):
            unread.append(heading)
    if unread:
        remarks.append(f"line {row.line}: columns that are not read: {list_names(unread)}")
    _complain_of_units(block_text, columns, remarks)
    _complain_of_axes(block_text, columns)
    return _Block(block_text, columns, positions)


def _complain_of_units(
    text: DelimitedText, columns: Sequence[ComponentColumn], remarks: list[str]
) -> None:
    assumed = []
    for column in columns:
        component = column.component
        if column.unit == UNIT_OF_COMPONENT:
            assumed.append(f"{column.name} in {component.unit.symbol}")
        elif component.unit not in COMPONENT_UNITS.get(column.unit, ()):
            text.problems.add(
                f"expected {component.code} in {component.unit.symbol} or a unit that can be "
                f"converted to it, got the unit {column.unit!r}",
                text.heading_line,
                text.place(column.index),
            )
    if assumed:
        remarks.append(f"columns that state no unit: read are {list_names(assumed)}")


def _complain_of_axes(text: DelimitedText, columns: Sequence[ComponentColumn]) -> None:
    """Refuse positions of another axis, and tables without any."""
    for column in columns:
        component = column.component
        if not component.is_table:
            continue
        heading = "" if column.position is None else text.headings[column.position]
        axis = _AXIS.fullmatch(normal_heading(heading))
        if column.position is None or (axis and axis[1] != component.axis):
            text.problems.add(
                f"expected a column of positions of {str(component.axis).upper()} at the left of "
                f"{component.code}, got {heading or 'none'}",
                text.heading_line,
                text.place(column.index),
            )


def _values(block: _Block, row: Row) -> Iterator[ComponentValue]:
    """Read a line: empty cells are places where a component was not measured."""
    for column in block.columns:
        if column.index >= len(row.cells) or not row.cells[column.index]:
            continue
        value = _read(block.text, row, column)
        position_mm = None
        position = None if column.position is None else block.positions.get(column.position)
        if column.component.is_table and position is not None:
            position_mm = block.text.number(row, position.index, position.symbol)
            if position_mm is not None:
                position_mm = POSITION.convert(position_mm, position.unit)
            elif not row.cells[position.index]:
                block.text.complain(row, position.index, "expected a position in mm, got none")
        if value is not None and (position_mm is None) != column.component.is_table:
            yield ComponentValue(block.text, row, column, position_mm, value)


def _read(text: DelimitedText, row: Row, column: ComponentColumn) -> float | None:
    component = column.component
    unit = component.unit.symbol if column.unit == UNIT_OF_COMPONENT else column.unit
    value = text.number(row, column.index, unit)
    if value is not None and column.unit != UNIT_OF_COMPONENT and column.unit in VALUE.factors:
        value = VALUE.convert(value, column.unit)
    if value is not None and (complaint := impossible_error(component, value)):
        text.complain(row, column.index, complaint)
        return None
    if value is not None and column.is_standard_error and value < 0:
        text.complain(row, column.index, "expected a standard error, which is not negative")
        return None
    return value


def _single_value(text: DelimitedText, row: Row) -> ComponentValue | None:
    """Read a line that names a component without positions, its value, and perhaps the unit."""
    cells = [(i, cell) for i, cell in enumerate(row.cells) if cell]
    if not 2 <= len(cells) <= 3 or read_number(cells[0][1]) is not None:
        return None
    column = component_column(cells[1][0], cells[0][1])
    if column is None or column.component.is_table or read_number(cells[1][1]) is None:
        return None
    if len(cells) == 3:
        column = replace(column, unit=normal_heading(cells[2][1]))
    headings = ["" for _ in row.cells]
    headings[column.index] = cells[0][1]
    single = replace(text, headings=headings, heading_line=row.line)
    _complain_of_units(single, [column], [])
    value = _read(single, row, column)
    return None if value is None else ComponentValue(single, row, column, None, value)
