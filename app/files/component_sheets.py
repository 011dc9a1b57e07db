"""Sheets with a column for each component, and what stands beside these tables of the whole.

A workbook may have a sheet for each axis, one for squareness, and a protocol: whose, when, and at
which temperatures (`Bed front; 18,1; °C`). Its sheets make one map, or one check.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Final

from app.decimal_text import read_number
from app.errors import list_names
from app.files.component_columns import (
    ComponentValue,
    component_headings,
    read_component_tables,
)
from app.files.csv_columns import normal_heading
from app.files.csv_comments import CELSIUS, without_unit
from app.files.delimited_text import (
    Comment,
    DelimitedText,
    Problems,
    Row,
    parse_delimited,
)
from app.files.table_limits import MOST_CELLS

_NAMES: Final = {
    **dict.fromkeys(
        ("date", "time", "measured", "measured_on", "measured_at", "datum", "measured_am"),
        "measured_at",
    ),
    **dict.fromkeys(("label", "title", "name_of_the_map"), "label"),
    "instrument": "instrument",
}
"""What a protocol calls what every table may state."""

_LOCAL_DATE: Final = re.compile(r"\d{1,4}(?:\.\d{1,2}\.|/\d{1,2}/|-\d{1,2}-)\d{2,4}\b", re.ASCII)

MOST_NAMED: Final = 8


@dataclass(frozen=True, slots=True)
class ComponentSheets:
    """The values of all sheets, their header lines under the first one's columns, all headings."""

    header: DelimitedText
    headings: frozenset[str]
    values: Sequence[ComponentValue]
    is_one_sheet: bool


def read_component_sheets(
    sheets: Mapping[str, str],
    problems: Problems,
    remarks: list[str],
    most: int | None = None,
    beside: Collection[str] = (),
) -> ComponentSheets | None:
    """Read sheets of which at least one has a column for each component; None where none has.

    Parameters
    ----------
    problems, remarks
        Take up what is wrong, and what is not read.
    most
        Lines of values that are accepted of each sheet.
    beside
        Columns that are read beside the components.
    """
    texts: dict[str, DelimitedText] = {}
    for title, written in sheets.items():
        problems.sheet = title if len(sheets) > 1 else ""
        texts[title] = parse_delimited(written, problems, most, is_one_table=False)
        if sum(len(text.headings) * len(text.rows) for text in texts.values()) > MOST_CELLS:
            problems.add(f"expected at most {MOST_CELLS} cells in all sheets, got more")
            problems.raise_if_any()
    problems.sheet = ""
    headings = frozenset().union(*map(component_headings, texts.values()))
    if not headings:
        return None
    values: list[ComponentValue] = []
    comments: list[Comment] = []
    for title, text in texts.items():
        problems.sheet = title if len(sheets) > 1 else ""
        tables = read_component_tables(text, remarks, beside)
        values += tables.values
        others = _comments_in(tables.others, problems, remarks, title)
        comments += [replace(c, sheet=problems.sheet) for c in (*text.comments, *others)]
    problems.sheet = ""
    header = replace(next(iter(texts.values())), comments=comments)
    return ComponentSheets(header, headings, values, len(texts) == 1)


def _comments_in(
    others: Iterable[Row], problems: Problems, remarks: list[str], title: str
) -> Iterable[Comment]:
    """Read a protocol's lines as header lines; what else has numbers is refused, or named."""
    unread: list[str] = []
    for row in others:
        cells = [cell for cell in row.cells if cell]
        comment = _as_comment(row.line, cells)
        if comment is not None:
            yield comment
        elif len(cells) > 3 and any(read_number(cell) is not None for cell in cells):
            problems.add(
                "expected a line of column names such as Position [mm], EXX [µm] above values, "
                f"got {list_names(cells, MOST_NAMED)}",
                row.line,
            )
        else:
            unread.append(" ".join(cells))
    if unread:
        of_sheet = f" in sheet {title!r}" if title else ""
        remarks.append(
            f"lines that are not read{of_sheet}: {list_names(map(repr, unread), MOST_NAMED)}"
        )


def _as_comment(line: int, cells: Sequence[str]) -> Comment | None:
    """Read a line of a name, its value and perhaps the unit; None where it is something else."""
    if not 2 <= len(cells) <= 3:
        return None
    name, *value = cells
    plain = name.strip(" :=")
    known_name = _NAMES.get(normal_heading(plain))
    if known_name is None and normal_heading(plain).startswith("repeatability"):
        known_name = plain
    if known_name is not None:
        is_time = known_name != "measured_at" or _is_moment(value[0])
        return _comment(line, known_name, value) if is_time else None
    sensor, number = (without_unit(text, CELSIUS) for text in (plain, value[0]))
    has_unit = (sensor, number) != (plain, value[0])
    if read_number(number) is None or not (has_unit or _is_celsius(value[-1])):
        return None
    return _comment(line, f"temperature {sensor.removeprefix('temperature ')}", [number])


def _is_celsius(cell: str) -> bool:
    return cell.strip("[]() ").lower() in CELSIUS


def _comment(line: int, name: str, value: Sequence[str]) -> Comment:
    return Comment(line, f"{name}: {' '.join(value)}", [name, *value])


def _is_moment(text: str) -> bool:
    """Say whether a text is a time; in a form of its country it is asked for, and said."""
    if _LOCAL_DATE.match(text):
        return True
    try:
        datetime.fromisoformat(text)
    except ValueError:
        return False
    return True
