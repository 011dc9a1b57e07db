"""Reading CSV as people and spreadsheets write it, with every complaint at its place.

Commas, semicolons or tabs between columns, or what a first line `sep=;` says; decimal
commas where columns are not separated by them; a byte order mark, blank lines and comment
lines (`#`) anywhere. An Excel workbook is read as if it had been saved as CSV.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, TypeAlias

from app.csv_text import without_marks
from app.decimal_text import read_number
from app.errors import ThermapError, counted, list_names
from app.files.code_pages import decoded
from app.files.table_limits import LONGEST_CELL, MOST_CELLS, MOST_COLUMNS, MOST_LINES, NoTable
from app.files.workbooks import read_sheets as cells_of_sheets

Message: TypeAlias = str | Callable[[], str]

MOST_PROBLEMS: Final = 8
"""Problems listed of one file: a wrong column is wrong in every line."""

LONGEST_LINE: Final = 20_000
"""Of a line [characters]."""

MOST_COMMENTS: Final = 1_000
"""Comment lines of a file."""

_DELIMITERS: Final = (";", "\t", ",")
"""The likeliest first: texts and numbers have commas too."""

_NO_DELIMITER: Final = re.compile('"[^"]*"|(?<=[,;])\t')
"""What is quoted, and a tab that only sets off a cell."""

_STATED_DELIMITER: Final = re.compile(r'"?sep=([^\w\s"]|\t)"?[\s;,]*', re.I)
"""Excel's first line, which says what parts the columns."""

_NEED_SEMICOLONS: Final = "; decimal commas need semicolons between the columns"

_STATEMENT: Final = re.compile(r"(label|measured[_ ]at|machine|temperature .+)", re.I)
"""What stands above the columns, in a comment line."""

_THOUSANDS: Final = re.compile(r"[+\N{MINUS SIGN}-]?[1-9]\d{0,2}([.,])\d{3}", re.ASCII)
"""A number of which nobody knows whether its mark parts decimals or thousands."""

_BYTE_ORDER_MARK: Final = "\N{ZERO WIDTH NO-BREAK SPACE}"

WORKBOOK: Final = b"PK\x03\x04"
"""How a workbook (.xlsx) begins, as every zip file does."""

OLD_WORKBOOK: Final = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
"""How a workbook of Excel 97 to 2003 (.xls) begins."""


@dataclass(frozen=True, slots=True)
class Lack:
    """What a file does not say, and who sends it may state beside it.

    Parameters
    ----------
    field
        Its name in a request, such as `measured_at`.
    """

    field: str
    message: str


class UnreadableFile(ThermapError):
    """A file says something that cannot be right: file, line, column, expected, came.

    `wrong` are the lines of what is wrong in the file itself, without what it only lacks.
    """

    def __init__(
        self, detail: str, wrong: Sequence[str] | None = None, lacks: Sequence[Lack] = ()
    ) -> None:
        super().__init__(detail)
        self.wrong = detail.split("\n") if wrong is None else wrong
        self.lacks = lacks


@dataclass(slots=True)
class Problems:
    """What is wrong with one file, collected so that all of it is said at once."""

    file: Path
    number: int = 0
    first: list[str] = field(default_factory=list)
    lacks: list[tuple[Lack, str]] = field(default_factory=list)
    sheet: str = ""
    """Of a workbook with several, the one that is being read."""
    _once: set[str] = field(default_factory=set)

    def add(self, message: Message, line: int | None = None, column: str = "") -> None:
        """Note a problem, with the number of its line and the column's name and number.

        A message that takes long to write is handed over as a function: most are never read.
        """
        self.number += 1
        if len(self.first) < MOST_PROBLEMS:
            words = message if isinstance(message, str) else message()
            self.first.append(f"{self._place(line, column)}: {words}")

    def add_once(self, message: str, line: int) -> None:
        """Note a problem of a line that every line below it would come upon."""
        if message not in self._once:
            self._once.add(message)
            self.add(message, line)

    def lack(self, field: str, message: str, how: str = "", line: int | None = None) -> None:
        """Note what the file does not say; `how` tells at the command line where it is stated."""
        self.lacks.append((Lack(field, message), f"{self._place(line)}: {message}{how}"))

    def _place(self, line: int | None, column: str = "") -> str:
        file = f"{self.file}, sheet {self.sheet!r}" if self.sheet else str(self.file)
        file = f"{file}, line {line}" if line else file
        return f"{file}, {column}" if column else file

    def listed(self) -> list[str]:
        """List the first problems, and how many more there are."""
        return self._cut([*self.first, *(text for _, text in self.lacks)], len(self.lacks))

    def _cut(self, texts: list[str], others: int = 0) -> list[str]:
        more = self.number + others - MOST_PROBLEMS
        return texts[:MOST_PROBLEMS] + ([f"{self.file}: … and {more} more"] if more > 0 else [])

    def raise_if_any(self) -> None:
        """Raise UnreadableFile with all of them."""
        if self.number or self.lacks:
            lacks = [lack for lack, _ in self.lacks]
            raise UnreadableFile("\n".join(self.listed()), self._cut(self.first), lacks)


@dataclass(frozen=True, slots=True)
class Row:
    """One line of values."""

    line: int
    cells: Sequence[str]


@dataclass(slots=True)
class _Marks:
    """The marks in a file's numbers: a comma or point is that of decimals, or parts thousands.

    `first_line` is where each mark comes first, and `doubtful` the first number of each that may
    be in thousands: row, column and text.
    """

    first_line: dict[str, int] = field(default_factory=dict)
    doubtful: dict[str, tuple[Row, int, str]] = field(default_factory=dict)
    is_said: bool = False

    def mistaken(self, row: Row, column: int, text: str) -> tuple[Row, int, str] | None:
        """Note a number; give, once, row, column and what is wrong where marks contradict."""
        mark = "," if "," in text else "." if "." in text else ""
        if not mark or self.is_said:
            return None
        self.first_line.setdefault(mark, row.line)
        if _THOUSANDS.fullmatch(text):
            self.doubtful.setdefault(mark, (row, column, text))
        for doubtful, other in ((",", "."), (".", ",")):
            if doubtful in self.doubtful and other in self.first_line:
                self.is_said = True
                at, where, got = self.doubtful[doubtful]
                name = "point" if other == "." else "comma"
                return (
                    at,
                    where,
                    f"expected numbers without marks between thousands, got {got!r} in a file "
                    f"that has a decimal {name} in line {self.first_line[other]}: is it "
                    f"{got.replace(doubtful, '')} or {got.replace(doubtful, other)}?",
                )
        return None


@dataclass(frozen=True, slots=True)
class Comment:
    """One comment line: its text without the sign, and the cells that it goes over."""

    line: int
    text: str
    cells: Sequence[str]
    sheet: str = ""
    """As `Problems.sheet`"""


@dataclass(frozen=True, slots=True)
class DelimitedText:
    """A file's comment lines, column names, and rows of the same length."""

    problems: Problems
    comments: Sequence[Comment]
    headings: Sequence[str]
    heading_line: int
    rows: Sequence[Row]
    decimal_comma: bool
    _marks: _Marks = field(default_factory=_Marks)

    def place(self, column: int) -> str:
        """Name a column for a message."""
        return f"column {column + 1} ({self.headings[column]})"

    def complain(self, row: Row, column: int, message: Message) -> None:
        """Note a problem with one cell."""
        self.problems.add(message, row.line, self.place(column))

    def number(self, row: Row, column: int, unit: str = "") -> float | None:
        """Read a cell's number; None where it is empty, or wrong and noted."""
        text = row.cells[column]
        if not text:
            return None
        value = read_number(text, decimal_comma=self.decimal_comma)
        if value is None:
            of_unit = f" in {unit}" if unit else ""
            self.complain(row, column, f"expected a number{of_unit}, got {text!r}")
        elif self.decimal_comma and (mistaken := self._marks.mistaken(row, column, text)):
            self.complain(*mistaken)
        return value


def read_delimited(file: Path, problems: Problems) -> DelimitedText:
    """Read a file into comments, column names and rows.

    Raises
    ------
    UnreadableFile
        As `parse_delimited`, and if there is no such file.
    """
    return parse_delimited(read_text(file), problems, is_sent=False)


def split_lines(text: str) -> list[str]:
    r"""Split a file's text at its ends of lines, and at nothing else that Unicode calls one.

    >>> split_lines("a\r\nb\rc\u2028d\n")
    ['a', 'b', 'c\u2028d']
    """
    unmarked = text.removeprefix(_BYTE_ORDER_MARK)
    lines = unmarked.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return lines if lines[-1] else lines[:-1]


def parse_delimited(
    text: str,
    problems: Problems,
    most: int | None = None,
    *,
    is_one_table: bool = True,
    is_sent: bool = True,
) -> DelimitedText:
    """Read a text into comments, column names and rows.

    Parameters
    ----------
    problems
        Takes up what is wrong, under the file's name.
    most
        Lines of values that are accepted; more are not read.
    is_one_table
        Whether the first line names the columns of all others; if not, it is as they are.
    is_sent
        Whether it may have been sent to a service; the user's own file is as long as it is.

    Raises
    ------
    UnreadableFile
        If there is no line of column names, or too many of values.
    """
    comments: list[tuple[int, str]] = []
    contents: list[tuple[int, str]] = []
    delimiter_named = None
    lines = text.count("\n") + text.count("\r") - text.count("\r\n")
    if is_sent and lines > MOST_LINES:
        problems.add(f"expected at most {MOST_LINES} lines, got more")
        problems.raise_if_any()
    for line, written in enumerate(split_lines(text), start=1):
        if len(written) > LONGEST_LINE:
            problems.add(f"expected at most {LONGEST_LINE} characters, got {len(written)}", line)
            problems.raise_if_any()
        if not contents and not delimiter_named and (says := _STATED_DELIMITER.fullmatch(written)):
            delimiter_named = says[1]
            continue
        bare = written.strip().strip('"').lstrip()
        if bare.startswith("#"):
            comments.append((line, written))
        elif written.strip(" \t;,"):
            contents.append((line, written))
    if not contents and not is_one_table:
        comments_read = [
            _comment(line, written, delimiter_named or "\t") for line, written in comments
        ]
        return DelimitedText(problems, comments_read, [], 0, [], decimal_comma=True)
    if not contents:
        problems.add("expected a line of column names and lines of values, got none")
        problems.raise_if_any()
    if most is not None and len(contents) > most + 1:
        problems.add(f"expected at most {most} lines of values, got {len(contents) - 1}")
        problems.raise_if_any()
    if len(comments) > MOST_COMMENTS:
        problems.add(f"expected at most {MOST_COMMENTS} comment lines, got {len(comments)}")
        problems.raise_if_any()
    heading_line, first = contents[0]
    delimiter = delimiter_named or _delimiter_of(written for _, written in contents)
    headings = _split(first, delimiter)
    while headings and not headings[-1]:
        headings.pop()
    if not headings:
        problems.add("expected column names, got none", heading_line)
        problems.raise_if_any()
    if is_sent:
        _expect_few_cells(len(headings), len(contents) - 1, heading_line, problems)
    rows = [Row(line, _split(written, delimiter)) for line, written in contents[1:]]
    if not is_one_table:
        headings += [""] * (max((len(row.cells) for row in rows), default=0) - len(headings))
        _expect_few_cells(len(headings), len(rows), heading_line, problems)
    for row in (Row(heading_line, headings), *rows):
        if any(len(cell) > LONGEST_CELL for cell in row.cells):
            problems.add(f"expected cells of at most {LONGEST_CELL} characters", row.line)
    problems.raise_if_any()
    if is_one_table:
        _expect_comments(heading_line, headings, rows, problems)
    decimal_comma = delimiter != ","
    if is_one_table:
        _expect_names(heading_line, headings, rows, problems, decimal_comma=decimal_comma)
    evened = [_evened(row, headings, heading_line, decimal_comma, problems) for row in rows]
    comments_read = [_comment(line, written, delimiter) for line, written in comments]
    return DelimitedText(problems, comments_read, headings, heading_line, evened, decimal_comma)


def read_text(file: Path) -> str:
    """Read a text file in whatever encoding spreadsheets write, or an Excel workbook as text.

    Raises
    ------
    UnreadableFile
        If it cannot be read, or a workbook does not hold one table.
    """
    return only_sheet(read_sheets(file), file)


def read_sheets(file: Path) -> Mapping[str, str]:
    """Read a file's sheets, as `sheets_of` does, and refuse one that is not there."""
    try:
        content = file.read_bytes()
    except OSError as error:
        raise UnreadableFile(f"{file}: {error.strerror}") from None
    return sheets_of(content, file)


def only_sheet(sheets: Mapping[str, str], file: Path) -> str:
    """Give the text of the one sheet that holds something, or refuse the file."""
    if len(sheets) == 1:
        return next(iter(sheets.values()))
    got = f"{len(sheets)}: {list_names(sheets)}" if sheets else "none"
    raise UnreadableFile(
        f"{file}: an Excel workbook: expected one sheet that holds values, got {got}; "
        "keep one, or save the one that is meant as CSV"
    )


def sheets_of(content: bytes, file: Path) -> Mapping[str, str]:
    """Read the sheets in a file that hold something: title to text.

    Text is one sheet without a title.

    Raises
    ------
    UnreadableFile
        If it is neither text nor a workbook.
    """
    if content.startswith((WORKBOOK, OLD_WORKBOOK)):
        try:
            return workbook_sheets(content)
        except NoTable as error:
            raise UnreadableFile(f"{file}: {error.detail}") from None
    text = decoded(content)
    if "\0" in text:  # no text has one; pictures and archives do
        raise UnreadableFile(
            f"{file}: expected text (CSV) or an Excel workbook, got a file of another kind"
        )
    return {"": text}


def _expect_few_cells(columns: int, lines: int, heading_line: int, problems: Problems) -> None:
    if columns > MOST_COLUMNS:
        problems.add(f"expected at most {MOST_COLUMNS} columns, got {columns}", heading_line)
        problems.raise_if_any()
    if columns * lines > MOST_CELLS:
        problems.add(
            f"expected at most {MOST_CELLS} cells, lines by columns, got {lines} by {columns}"
        )
        problems.raise_if_any()


def left_out(headings: Iterable[str]) -> str:
    """Say which columns are not read."""
    return f"columns that are not read: {list_names(headings)}"


def _delimiter_of(lines: Iterable[str]) -> str:
    r"""Give what parts the columns: what most lines have.

    >>> _delimiter_of(["Title;Cold, in the morning", "Position;EXX", "0;1,2"])
    ';'
    >>> _delimiter_of(["Position, mm\tEXX, µm", "0\t1,2"]), _delimiter_of(["0,\t1.2"])
    ('\t', ',')
    """
    bare = [_NO_DELIMITER.sub("", line) for line in lines]
    return max(_DELIMITERS, key=lambda delimiter: sum(delimiter in line for line in bare))


def _split(text: str, delimiter: str) -> list[str]:
    return [without_marks(cell.strip()) for cell in next(csv.reader([text], delimiter=delimiter))]


def _comment(line: int, written: str, delimiter: str) -> Comment:
    """Read a comment line, whose value may stand in a cell of its own as spreadsheets have it.

    >>> _comment(1, '"# label";"Run 1"', ";").cells
    ['label', 'Run 1']
    """
    first, *others = _split(written, delimiter)
    cells = [cell for cell in (first.lstrip("# \t"), *others) if cell]
    bare = without_marks(written.strip().lstrip("#").strip(" \t;,"))
    text = " ".join(cells) if '"' in written else bare
    return Comment(line, text, cells)


def _expect_comments(
    line: int, headings: Sequence[str], rows: Sequence[Row], problems: Problems
) -> None:
    """Refuse what is stated above the columns without #, instead of taking it for columns."""
    comment, *values = [heading for heading in headings if heading]
    key, _, rest = comment.partition(":")
    wider = any(sum(map(bool, row.cells)) > len(headings) for row in rows)
    if wider and len(values) <= 1 and _STATEMENT.fullmatch(key.strip()):
        value = " ".join([rest.strip(), *values]).strip()
        problems.add(
            "expected # before each line above the column names, such as "
            f"`# {key.strip()}: {value}`, got {' '.join([comment, *values])!r}",
            line,
        )
        problems.raise_if_any()


def _expect_names(
    line: int,
    headings: Sequence[str],
    rows: Sequence[Row],
    problems: Problems,
    *,
    decimal_comma: bool,
) -> None:
    """Refuse a first line that cannot name the columns, as most lines below it have more."""
    wider = [row for row in rows if any(row.cells[len(headings) :])]
    if len(wider) > max(len(rows) / 2, 1):
        problems.add(
            f"expected the names of {len(wider[0].cells)} columns, as line {wider[0].line} has, "
            f"got {len(headings)}; what stands above the column names begins with #"
            f"{'' if decimal_comma else _NEED_SEMICOLONS}",
            line,
        )
        problems.raise_if_any()


def _evened(
    row: Row, headings: Sequence[str], heading_line: int, decimal_comma: bool, problems: Problems
) -> Row:
    """Give a row as many cells as there are columns."""
    missing = len(headings) - len(row.cells)
    if missing >= 0:
        return Row(row.line, [*row.cells, *[""] * missing])
    if any(row.cells[len(headings) :]):
        hint = "" if decimal_comma else _NEED_SEMICOLONS
        problems.add(
            f"expected {counted(len(headings), 'column')} as in line {heading_line}, "
            f"got {len(row.cells)}{hint}",
            row.line,
        )
    return Row(row.line, row.cells[: len(headings)])


def workbook_sheets(content: bytes) -> dict[str, str]:
    """Write the sheets that hold something as text with tabs between the columns.

    Returns
    -------
    dict
        Title to a line for each row, as they are numbered in the sheet; formulas as their values.

    Raises
    ------
    NoTable
        If it is no workbook.
    """
    if content.startswith(OLD_WORKBOOK):
        raise NoTable("an old Excel workbook (.xls): save it as CSV or .xlsx")
    return {
        title: "".join(_line(cells) for cells in rows)
        for title, rows in cells_of_sheets(content).items()
        if any(rows)
    }


def _line(cells: Sequence[str]) -> str:
    """Write one line."""
    if not cells:
        return "\n"
    text = io.StringIO()
    csv.writer(text, delimiter="\t", quoting=csv.QUOTE_ALL, lineterminator="\n").writerow(cells)
    return text.getvalue()
