"""What a measurement's file is: the comment lines and columns of a method, and its body."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from app.errors import InvalidContent, list_names
from app.files.csv_columns import LENGTH, POSITION, SMALL_ANGLE, Columns, Named
from app.files.csv_comments import Statement
from app.files.delimited_text import DelimitedText, Row
from app.geometry.body_diagonal import DIAGONALS

Body = dict[str, Any]
"""Fields of `POST …/measurements/{method}`, without label, time and temperatures."""

ReadBody = Callable[[DelimitedText, Mapping[str, Any], list[str]], Body]
"""Takes the file, what its comment lines state, and the list of remarks."""

RUN: Final = Named("run", None, ("cycle",))

REPEATABILITY: Final = Statement(Named("repeatability", LENGTH), 1, "repeatability_um: 0.5")
REPEATABILITY_OF_ANGLES: Final = Statement(
    Named("repeatability", SMALL_ANGLE), 1, "repeatability_urad: 0.5"
)
TOOL_OFFSET: Final = Statement(Named("tool_offset", POSITION), 3, "tool_offset_mm: 0, 0, 160")
MEASURING_LINE: Final = Statement(
    Named("measuring_line", POSITION), 3, "measuring_line_mm: 0, 250, 100"
)

DIAGONAL: Final = Named("diagonal", None)

Readings = dict[str, list[list[float]]]
"""Field to its runs over the positions."""


@dataclass(frozen=True, slots=True)
class Format:
    """A method's file.

    Parameters
    ----------
    statements
        The comment lines that it reads beside label, time and temperatures.
    is_dated
        Whether its lines state times and temperatures themselves, so that maps need a label alone.
    """

    statements: tuple[Statement, ...]
    read: ReadBody
    is_dated: bool = False


def word_among(what: str, *words: str) -> Callable[[str], str]:
    """Make a reader of one of some words, in any case of letters."""

    def read(text: str) -> str:
        matching = [word for word in words if word.lower() == text.lower()]
        if not matching:
            raise InvalidContent(f"expected {what} among {list_names(words)}, got {text!r}")
        return matching[0]

    return read


def axis_among(*letters: str) -> Statement:
    """Make the line that names an axis."""
    return Statement(
        Named("axis", None), 0, f"axis: {letters[0]}", True, word_among("axis", *letters)
    )


def choice_among(field: str, *words: str) -> Statement:
    """Make a line that names one of several ways."""
    return Statement(
        Named(field, None), 0, f"{field}: {words[0]}", False, word_among(field, *words)
    )


@dataclass(slots=True)
class Runs:
    """Readings by field, run and position, as the lines of a table bring them.

    Runs are numbered by the table, or else counted: the second line with the same
    position is the second run.
    """

    columns: Columns
    found: dict[tuple[str, float], dict[float, float]] = field(default_factory=dict)
    counted: Counter[tuple[str, float]] = field(default_factory=Counter)
    rows: dict[float, Row] = field(default_factory=dict)
    wrong: set[tuple[str, float]] = field(default_factory=set)

    def add(
        self, row: Row, position: float, name: str, value: float | None, run: float | None
    ) -> None:
        """Take one reading; None is one that was complained of already."""
        self.rows.setdefault(position, row)
        if value is None:
            self.wrong.add((name, position))
            return
        if run is None:
            self.counted[name, position] += 1
            run = float(self.counted[name, position])
        readings = self.found.setdefault((name, run), {})
        if position in readings:
            self.columns.text.problems.add(
                f"expected {name} of run {run:g} at {position:g} mm once, came again", row.line
            )
        readings[position] = value

    def in_order(self) -> tuple[list[float], Readings]:
        """Give the positions, increasing, and each field's runs over them.

        A run that lacks a position is noted at the position's first line, and the runs after it
        are not looked at: where there is a run for each line, each of them lacks all the others.
        """
        positions = sorted(self.rows)
        readings: Readings = {}
        for name, run in sorted(self.found):
            values = self.found[name, run]
            lacking = (
                [p for p in positions if p not in values and (name, p) not in self.wrong]
                if len(values) < len(positions)
                else []
            )
            for position in lacking:
                self.columns.text.problems.add(
                    f"expected {name} of run {run:g} at {position:g} mm, got none",
                    self.rows[position].line,
                    self._place(name),
                )
            if lacking:
                break
            readings.setdefault(name, []).append([values[p] for p in positions if p in values])
        return positions, readings

    def _place(self, name: str) -> str:
        column = self.columns.by_field.get(name)
        return self.columns.text.place(column.index) if column else ""


def read_runs(columns: Columns, position: str, names: Sequence[str], rows: Sequence[Row]) -> Runs:
    """Read lines with one position each, and a reading of some fields.

    Parameters
    ----------
    columns
        The table's columns; a column `run` numbers the runs.
    names
        Fields of the readings; their cells may be empty, but not all of a line.
    """
    runs = Runs(columns)
    for row, at, run in positions_and_runs(columns, position, rows):
        read = [name for name in names if columns.word(row, name)]
        for name in read:
            runs.add(row, at, name, columns.number(row, name), run)
        requested = [name for name in names if name in columns]
        if requested and not read:
            columns.text.problems.add(
                f"expected a reading of {list_names(requested)}, got none", row.line
            )
    return runs


def positions_and_runs(
    columns: Columns, position: str, rows: Sequence[Row]
) -> Iterator[tuple[Row, float, float | None]]:
    """Go through the lines that have a position, with the run that they state."""
    for row in rows:
        at = columns.needed(row, position)
        run = columns.needed(row, "run") if "run" in columns else None
        if at is not None and (run is not None or "run" not in columns):
            yield row, at, run


def flat_if_one(runs: list[list[float]]) -> list[float] | list[list[float]]:
    """Write one run as a list, several as a list of lists."""
    return runs[0] if len(runs) == 1 else runs


def rows_by_diagonal(columns: Columns) -> dict[str, list[Row]]:
    """Sort the lines of a table by the diagonal that they name."""
    by_diagonal: dict[str, list[Row]] = {}
    for row in columns.text.rows:
        name = columns.word(row, "diagonal").lower()
        if name in DIAGONALS:
            by_diagonal.setdefault(name, []).append(row)
        else:
            columns.complain(
                row, "diagonal", f"expected a diagonal among {list_names(DIAGONALS)}, got {name!r}"
            )
    return by_diagonal
