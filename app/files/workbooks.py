"""Excel workbooks (.xlsx): what stands in their sheets, counted while it is unpacked.

A workbook is a zip of XML parts: `workbook.xml` names the sheets, `sharedStrings.xml` has the
texts, `styles.xml` says which numbers are dates. Libraries build objects of all of it, and a few
kilobytes can be made to fill any memory; of this one only cells leave the stream.
"""

from __future__ import annotations

import io
import posixpath
import re
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Final
from xml.parsers import expat

from app.decimal_text import LONGEST_NUMBER, read_number
from app.files.table_limits import LONGEST_CELL, MOST_CELLS, MOST_COLUMNS, MOST_LINES, NoTable
from app.units import SECONDS_PER_DAY

MOST_UNPACKED: Final = 64 * 1024 * 1024
"""Of all parts that are read [bytes]."""

MOST_TAGS: Final = 6_000_000
"""Of XML, in all parts that are read: each costs time."""

DEEPEST: Final = 200
"""Elements of XML in one another."""

MOST_CHARACTERS: Final = 32 * 1024 * 1024
"""Of all cells together: a text that stands once in a file may stand in every cell."""

MOST_PARTS: Final = 10_000
"""Files in the zip."""

_DIRECTORY_ENTRY: Final = b"PK\x01\x02"
_CHUNK: Final = 64 * 1024
"""Nothing between two events of XML is as long [bytes]: expat reads it anew with each piece."""

_CELL: Final = re.compile(r"([A-Za-z]{1,3})([0-9]{1,7})")
_ESCAPED: Final = re.compile(r"_x([0-9A-Fa-f]{4})_")
_NO_DATE: Final = re.compile(r'"[^"]*"|\[[^\[\]]*\]|[\\_*].', re.DOTALL)
"""Of a number's format: texts, colours, and letters that stand for themselves."""

_DURATION: Final = re.compile(r"\[(?:h{1,9}|m{1,9}|s{1,9})\]", re.IGNORECASE)
_DATES: Final = frozenset(("14", "15", "16", "17", "18", "19", "20", "21", "22", "45", "47"))
_HOURS: Final = "46"
"""Formats of dates, and of durations, that every workbook has."""

_LONGEST_FORMAT: Final = 255

Rows = Sequence[Sequence[str]]


def read_sheets(content: bytes) -> dict[str, Rows]:
    """Read what stands in a workbook's sheets.

    Returns
    -------
    dict
        Name of each sheet to its rows as they are numbered; each has its cells as text to the last
        one that holds something, dates in ISO 8601 and formulas as their values.

    Raises
    ------
    NoTable
        If it is no workbook, or beyond a limit.
    """
    if content.count(_DIRECTORY_ENTRY) > MOST_PARTS:
        raise NoTable(f"expected at most {MOST_PARTS} files in a workbook, got more")
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            return _Workbook(_Parts(archive)).sheets()
    except (
        *(zipfile.BadZipFile, zlib.error, expat.ExpatError, EOFError, OSError),
        *(KeyError, ValueError, IndexError, RuntimeError, NotImplementedError),
    ) as error:
        raise NoTable(f"expected CSV or an Excel workbook (.xlsx), got neither: {error}") from None


@dataclass(slots=True)
class _Parts:
    """The parts of a workbook, counted together while they are read."""

    archive: zipfile.ZipFile
    bytes_read: int = 0
    tags: int = 0
    depth: int = 0
    events: int = 0

    def read(self, name: str, reader: _Reader) -> None:
        """Hand a part's elements to a reader."""
        parser = expat.ParserCreate(namespace_separator=" ")
        parser.buffer_text = True

        def start(element: str, attributes: dict[str, str]) -> None:
            self._count_element()
            reader.start(_local(element), {_local(k): v for k, v in attributes.items()})

        def end(element: str) -> None:
            self.depth -= 1
            reader.end(_local(element))

        def text(text: str) -> None:
            self.events += 1
            reader.text(text)

        def other(*_: object) -> None:
            self.events += 1

        parser.StartElementHandler, parser.EndElementHandler = start, end
        parser.CharacterDataHandler = text
        parser.CommentHandler = parser.ProcessingInstructionHandler = other
        parser.StartDoctypeDeclHandler = _refuse_doctype
        parser.XmlDeclHandler = _expect_unicode
        self._count_part(name)
        self.depth = 0
        for piece in self._pieces(name):
            before = self.events
            parser.Parse(piece, False)
            if self.events == before and len(piece) == _CHUNK:
                raise NoTable(f"expected XML in {name!r}, got {_CHUNK} bytes without an element")
        parser.Parse(b"", True)

    def _count_element(self) -> None:
        self.events += 1
        self.depth += 1
        if self.depth > DEEPEST:
            raise NoTable(f"expected elements at most {DEEPEST} deep in one another, got more")

    def _count_part(self, name: str) -> None:
        """Count a part before it is read: to unpack it costs little beside reading it."""
        for piece in self._pieces(name):
            self.bytes_read += len(piece)
            self.tags += piece.count(b"<")
            if self.bytes_read > MOST_UNPACKED:
                raise NoTable(
                    f"expected a workbook that unpacks to at most {MOST_UNPACKED} bytes, got more"
                )
            if self.tags > MOST_TAGS:
                raise NoTable(f"expected a workbook of at most {MOST_TAGS} tags of XML, got more")

    def _pieces(self, name: str) -> Iterator[bytes]:
        """Unpack a part, piece by piece."""
        entry = self.archive.getinfo(name)
        # Python's bzip2 and LZMA unpack a piece of the file whole, whatever it grows to.
        if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise NoTable(f"expected {name!r} stored or deflated, got another packing")
        with self.archive.open(entry) as source:
            while piece := source.read(_CHUNK):
                yield piece


def _local(name: str) -> str:
    return name.rpartition(" ")[2]


def _expect_unicode(_version: str, encoding: str | None, _standalone: int) -> None:
    # In another code page "<" may be another byte, and tags would not be counted.
    if encoding is not None and encoding.upper() not in ("UTF-8", "UTF-16"):
        raise NoTable(f"expected a workbook in UTF-8 or UTF-16, got {encoding[:20]!r}")


def _refuse_doctype(*_: object) -> None:
    raise NoTable("expected a workbook without document types, got one with entities")


class _Reader:
    """Takes a part's elements up; what it does not know it leaves."""

    def start(self, element: str, attributes: Mapping[str, str]) -> None:
        """Take the begin of an element."""

    def end(self, element: str) -> None:
        """Take its end."""

    def text(self, text: str) -> None:
        """Take text."""


@dataclass(slots=True)
class _Attributes(_Reader):
    """Hands the attributes of some elements on."""

    wanted: Mapping[str, Callable[[Mapping[str, str]], None]]

    def start(self, element: str, attributes: Mapping[str, str]) -> None:
        if element in self.wanted:
            self.wanted[element](attributes)


@dataclass(slots=True)
class _Workbook:
    """What one part says of the others."""

    parts: _Parts
    begin: datetime = datetime(1899, 12, 30)
    strings: list[str] = field(default_factory=list)
    dates: Mapping[int, str] = field(default_factory=dict)
    cells: int = 0
    characters: int = 0

    def sheets(self) -> dict[str, Rows]:
        """Read all sheets."""
        main = self._targets("_rels/.rels", "")
        name = next((target for kind, target in main.values() if kind == "officeDocument"), "")
        folder, _, file = name.rpartition("/")
        related = self._targets(f"{folder}/_rels/{file}.rels".lstrip("/"), folder)
        listed: list[tuple[str, str]] = []

        def sheet(attributes: Mapping[str, str]) -> None:
            listed.append((attributes["name"], attributes["id"]))

        def properties(attributes: Mapping[str, str]) -> None:
            if attributes.get("date1904") in ("1", "true", "on"):
                self.begin = datetime(1904, 1, 1)

        self.parts.read(name, _Attributes({"sheet": sheet, "workbookPr": properties}))
        for kind, target in related.values():
            if kind == "sharedStrings":
                strings = _Strings()
                self.parts.read(target, strings)
                self.strings = strings.found
            elif kind == "styles":
                styles = _Styles()
                self.parts.read(target, styles)
                self.dates = styles.dates
        sheets: dict[str, Rows] = {}
        for title, number in listed:
            kind, target = related.get(number, ("", ""))
            if kind == "worksheet":
                rows = _Sheet(self)
                self.parts.read(target, rows)
                sheets[title] = rows.found
        return sheets

    def _targets(self, name: str, folder: str) -> dict[str, tuple[str, str]]:
        """Read a part's relations: number to kind and target."""
        targets: dict[str, tuple[str, str]] = {}

        def relation(attributes: Mapping[str, str]) -> None:
            if attributes.get("TargetMode") != "External":
                target = posixpath.normpath(posixpath.join("/", folder, attributes["Target"]))
                kind = attributes["Type"].rpartition("/")[2]
                targets[attributes["Id"]] = kind, target.lstrip("/")

        self.parts.read(name, _Attributes({"Relationship": relation}))
        return targets

    def count(self, row: Sequence[str]) -> None:
        """Count a row's cells, empty ones too, and what stands in them."""
        self.cells += len(row)
        self.characters += sum(map(len, row))
        if self.cells > MOST_CELLS:
            raise NoTable(f"expected a workbook of at most {MOST_CELLS} cells, got more")
        if self.characters > MOST_CHARACTERS:
            raise NoTable(f"expected a workbook of at most {MOST_CHARACTERS} characters, got more")

    def date(self, days: float, *, is_duration: bool) -> str:
        """Write the date, the time of day or the duration that a number of days means.

        Raises
        ------
        ValueError
            If it is none.
        """
        try:
            if is_duration:
                return str(timedelta(seconds=round(days * SECONDS_PER_DAY, 3)))
            # 1900 was no leap year, but for Excel it was.
            early = 0 < days < 60 and self.begin.year == 1899
            whole, rest = divmod(days, 1)
            seconds = round(rest * SECONDS_PER_DAY, 3)
            moment = self.begin + timedelta(days=whole + early, seconds=seconds)
        except OverflowError as error:
            raise ValueError(days) from error
        return f"{moment:%H:%M:%S}" if 0 <= days < 1 else moment.isoformat()


@dataclass(slots=True)
class _Strings(_Reader):
    """The texts that cells share; a long one is cut, and refused where a cell has it."""

    found: list[str] = field(default_factory=list)
    _parts: list[str] = field(default_factory=list)
    _takes: bool = False
    _is_phonetic: bool = False

    def start(self, element: str, attributes: Mapping[str, str]) -> None:
        self._takes = element == "t" and not self._is_phonetic
        self._is_phonetic = self._is_phonetic or element == "rPh"

    def end(self, element: str) -> None:
        self._takes = False
        if element == "rPh":
            self._is_phonetic = False
        elif element == "si":
            self.found.append("".join(self._parts)[: LONGEST_CELL + 1])
            self._parts.clear()

    def text(self, text: str) -> None:
        if self._takes:
            self._parts.append(text)


@dataclass(slots=True)
class _Styles(_Reader):
    """Which styles of cells are dates ("date") or durations ("duration")."""

    dates: dict[int, str] = field(default_factory=dict)
    _formats: dict[str, str] = field(
        default_factory=lambda: {**dict.fromkeys(_DATES, "date"), _HOURS: "duration"}
    )
    _styles: int = 0
    _is_of_cells: bool = False

    def start(self, element: str, attributes: Mapping[str, str]) -> None:
        if element == "numFmt":
            kind = _kind_of_format(attributes.get("formatCode", ""))
            if kind:
                self._formats[attributes.get("numFmtId", "")] = kind
        elif element == "cellXfs":
            self._is_of_cells = True
        elif element == "xf" and self._is_of_cells:
            kind = self._formats.get(attributes.get("numFmtId", ""), "")
            if kind:
                self.dates[self._styles] = kind
            self._styles += 1

    def end(self, element: str) -> None:
        if element == "cellXfs":
            self._is_of_cells = False


def _kind_of_format(code: str) -> str:
    """Say whether numbers of a format are dates or durations; empty where neither.

    >>> [_kind_of_format(code) for code in ('yyyy-mm-dd', '[hh]:mm', '0.00 "days"', '[Red]0.0')]
    ['date', 'duration', '', '']
    """
    if len(code) > _LONGEST_FORMAT:
        return ""
    code = code.partition(";")[0]
    if _DURATION.search(code):
        return "duration"
    return "date" if set(_NO_DATE.sub("", code).lower()) & set("dmhys") else ""


@dataclass(slots=True)
class _Sheet(_Reader):
    """The rows of a sheet."""

    book: _Workbook
    found: list[list[str]] = field(default_factory=list)
    _row: dict[int, str] = field(default_factory=dict)
    _number: int = 0
    _column: int = 0
    _kind: str = ""
    _style: str = ""
    _value: list[str] = field(default_factory=list)
    _takes: bool = False
    _is_phonetic: bool = False

    def start(self, element: str, attributes: Mapping[str, str]) -> None:
        self._takes = False
        if element == "row":
            reference = attributes.get("r", "")
            number = int(reference[:LONGEST_NUMBER]) if reference else self._number + 1
            if not self._number < number <= MOST_LINES:
                raise NoTable(
                    f"expected rows in order, at most {MOST_LINES}, got row {number} after row "
                    f"{self._number}"
                )
            self._number, self._column = number, 0
            self._row = {}
        elif element == "c":
            self._column = _column_of(attributes.get("r", ""), self._column)
            self._kind, self._style = attributes.get("t", "n"), attributes.get("s", "")
            self._value = []
        elif element == "rPh":
            self._is_phonetic = True
        else:
            self._takes = element == "v" or (
                element == "t" and self._kind == "inlineStr" and not self._is_phonetic
            )

    def text(self, text: str) -> None:
        if self._takes:
            self._value.append(text)

    def end(self, element: str) -> None:
        self._takes = False
        if element == "rPh":
            self._is_phonetic = False
        elif element == "c":
            self._end_cell()
        elif element == "row":
            self._end_row()

    def _end_cell(self) -> None:
        text = self._written("".join(self._value))
        if len(text) > LONGEST_CELL:
            raise NoTable(
                f"row {self._number}: expected cells of at most {LONGEST_CELL} characters, got more"
            )
        text = " ".join(_ESCAPED.sub(lambda code: chr(int(code[1], 16)), text).split())
        if not text:
            return
        if self._column > MOST_COLUMNS:
            raise NoTable(
                f"row {self._number}: expected at most {MOST_COLUMNS} columns, got one that holds "
                f"something in column {self._column}"
            )
        self._row[self._column] = text

    def _end_row(self) -> None:
        if self._row:
            empty: list[str] = []
            self.found += [empty] * (self._number - 1 - len(self.found))
            row = [self._row.get(column, "") for column in range(1, max(self._row) + 1)]
            self.book.count(row)
            self.found.append(row)
            self._row = {}

    def _written(self, value: str) -> str:
        """Write a value as its kind has it."""
        if not value:
            return ""
        if self._kind == "s":
            return self.book.strings[int(value[:LONGEST_NUMBER])]
        if self._kind == "b":
            return str(value not in ("0", "false"))
        number = read_number(value, decimal_comma=False)
        if self._kind != "n" or number is None:
            return value
        kind = self.book.dates.get(int(self._style[:LONGEST_NUMBER] or 0))
        try:
            if kind is not None:
                return self.book.date(number, is_duration=kind == "duration")
            text = str(number) if set(value) & set(".eE") else str(int(value))
        except ValueError:
            return value
        # As text, three decimals could be thousands; a number leaves no such doubt.
        return f"{text}0" if text[-4:-3] == "." else text


def _column_of(reference: str, last: int) -> int:
    """Give a cell's column from 1; the next one where it states none."""
    if not reference:
        return last + 1
    match = _CELL.fullmatch(reference)
    if match is None:
        raise NoTable(f"expected a cell such as B7, got {reference[:20]!r}")
    column = 0
    for letter in match[1].upper():
        column = column * 26 + ord(letter) - ord("A") + 1
    return column
