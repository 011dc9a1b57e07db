"""Reading CSV as people and spreadsheets write it, with every complaint at its place.

Commas, semicolons or tabs between columns, or what a first line `sep=;` says; decimal
commas where columns are not separated by them; a byte order mark, blank lines and comment
lines (`#`) anywhere. An Excel workbook is read as if it had been saved as CSV.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from app.cli.options import read_number
from app.cli.workbook import OLD_WORKBOOK, WORKBOOK, NoTable, workbook_text
from app.errors import ThermapError, counted, list_names

SHOWN: Final = 8
"""Problems listed of one file: a wrong column is wrong in every line."""

_DELIMITERS: Final = (",", ";", "\t")
_QUOTED: Final = re.compile('"[^"]*"')
_STATED_DELIMITER: Final = re.compile(r'"?sep=(.)"?[\s;,]*', re.I)
"""Excel's first line, which says what parts the columns."""

_BYTE_ORDER_MARK: Final = "\N{ZERO WIDTH NO-BREAK SPACE}"


class UnreadableFile(ThermapError):
    """A file says something that cannot be right: file, line, column, expected, came."""


@dataclass(slots=True)
class Problems:
    """What is wrong with one file, collected so that all of it is said at once."""

    file: Path
    found: list[str] = field(default_factory=list)

    def add(self, message: str, line: int | None = None, column: str = "") -> None:
        """Note a problem, with the number of its line and the column's name and number."""
        place = "".join(
            (str(self.file), f", line {line}" if line else "", f", {column}" if column else "")
        )
        self.found.append(f"{place}: {message}")

    def listed(self) -> list[str]:
        """List the first problems, and how many more there are."""
        more = len(self.found) - SHOWN
        return self.found[:SHOWN] + ([f"{self.file}: … and {more} more"] if more > 0 else [])

    def raise_if_any(self) -> None:
        """Raise UnreadableFile with all of them."""
        if self.found:
            raise UnreadableFile("\n".join(self.listed()))


@dataclass(frozen=True, slots=True)
class Row:
    """One line of values."""

    line: int
    cells: Sequence[str]


@dataclass(frozen=True, slots=True)
class DelimitedText:
    """A file's comment lines, column names, and rows of the same length."""

    problems: Problems
    comments: Sequence[tuple[int, str]]
    headings: Sequence[str]
    heading_line: int
    rows: Sequence[Row]
    decimal_comma: bool

    def place(self, column: int) -> str:
        """Name a column for a message."""
        return f"column {column + 1} ({self.headings[column]})"

    def complain(self, row: Row, column: int, message: str) -> None:
        """Note a problem with one cell."""
        self.problems.add(message, row.line, self.place(column))

    def number(self, row: Row, column: int, unit: str = "") -> float | None:
        """Read a cell's number; None where it is empty, or wrong and noted."""
        text = row.cells[column]
        if not text:
            return None
        found = read_number(text, decimal_comma=self.decimal_comma)
        if found is None:
            of_unit = f" in {unit}" if unit else ""
            self.complain(row, column, f"expected a number{of_unit}, came {text!r}")
        return found


def read_delimited(file: Path, problems: Problems, most: int | None = None) -> DelimitedText:
    """Read a file into comments, column names and rows.

    Raises
    ------
    UnreadableFile
        As `parse_delimited`, and if there is no such file.
    """
    return parse_delimited(read_text(file), problems, most)


def parse_delimited(text: str, problems: Problems, most: int | None = None) -> DelimitedText:
    """Read a text into comments, column names and rows.

    Parameters
    ----------
    text
        The whole file.
    problems
        Takes up what is wrong, under the file's name.
    most
        Lines of values that are accepted; more are not read.

    Raises
    ------
    UnreadableFile
        If there is no line of column names, or too many of values.
    """
    comments: list[tuple[int, str]] = []
    contents: list[tuple[int, str]] = []
    stated = None
    for line, written in enumerate(text.removeprefix(_BYTE_ORDER_MARK).splitlines(), start=1):
        if not contents and not stated and (says := _STATED_DELIMITER.fullmatch(written)):
            stated = says[1]
            continue
        bare = written.strip().strip('"').lstrip()
        if bare.startswith("#"):
            comments.append((line, bare.lstrip("#").strip(' \t;,"')))
        elif written.strip(" \t;,"):
            contents.append((line, written))
    if not contents:
        problems.add("expected a line of column names and lines of values, came none")
        problems.raise_if_any()
    if most is not None and len(contents) > most + 1:
        problems.add(f"expected at most {most} lines of values, came {len(contents) - 1}")
        problems.raise_if_any()
    heading_line, first = contents[0]
    delimiter = stated or max(_DELIMITERS, key=_QUOTED.sub("", first).count)
    headings = _split(first, delimiter)
    while headings and not headings[-1]:
        headings.pop()
    rows = [Row(line, _split(written, delimiter)) for line, written in contents[1:]]
    decimal_comma = delimiter != ","
    evened = [_evened(row, headings, heading_line, decimal_comma, problems) for row in rows]
    return DelimitedText(problems, comments, headings, heading_line, evened, decimal_comma)


def read_text(file: Path) -> str:
    """Read a text file in whatever encoding spreadsheets write, or an Excel workbook as text.

    Raises
    ------
    UnreadableFile
        If it cannot be read, or a workbook does not hold one table.
    """
    try:
        content = file.read_bytes()
    except OSError as error:
        raise UnreadableFile(f"{file}: {error.strerror}") from None
    if content.startswith((WORKBOOK, OLD_WORKBOOK)):
        try:
            return workbook_text(content)
        except NoTable as error:
            raise UnreadableFile(f"{file}: {error.detail}") from None
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


def plain_heading(heading: str) -> str:
    """Write a column's name in one way: small letters, units in ASCII after an underscore.

    >>> plain_heading("Error [µm]"), plain_heading("error_um/m"), plain_heading("Position (mm)")
    ('error_um', 'error_um_per_m', 'position_mm')
    """
    ascii_units = heading.lower().replace("µ", "u").replace("μ", "u").replace("°", "")
    return re.sub(r"[\s\[\]()]+", "_", ascii_units.replace("/", "_per_")).strip("_")


def left_out(headings: Iterable[str]) -> str:
    """Say which columns are not read."""
    return f"columns that are not read: {list_names(headings)}"


def _split(text: str, delimiter: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([text], delimiter=delimiter))]
    except csv.Error:  # a field of more than 128 KiB: no number, no name
        return [text[:80]]


def _evened(
    row: Row, headings: Sequence[str], heading_line: int, decimal_comma: bool, problems: Problems
) -> Row:
    """Give a row as many cells as there are columns."""
    missing = len(headings) - len(row.cells)
    if missing >= 0:
        return Row(row.line, [*row.cells, *[""] * missing])
    if any(row.cells[len(headings) :]):
        hint = "" if decimal_comma else "; decimal commas need semicolons between the columns"
        problems.add(
            f"expected {counted(len(headings), 'column')} as in line {heading_line}, "
            f"came {len(row.cells)}{hint}",
            row.line,
        )
    return Row(row.line, row.cells[: len(headings)])
