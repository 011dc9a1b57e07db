"""Readings of repeated runs over the same positions, put in order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from app.cli.csv_measurements.columns import Columns
from app.cli.delimited_text import Row

Readings = dict[str, list[list[float]]]
"""Field to its runs over the positions."""


@dataclass(slots=True)
class Runs:
    """Readings by field, run and position, as the lines of a table bring them.

    Runs are numbered by the table, or else counted: the second line with the same
    position is the second run.
    """

    columns: Columns
    found: dict[tuple[str, float], dict[float, float]] = field(default_factory=dict)
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
            run = 1.0 + sum(position in self.found[key] for key in self.found if key[0] == name)
        readings = self.found.setdefault((name, run), {})
        if position in readings:
            self.columns.text.problems.add(
                f"expected {name} of run {run:g} at {position:g} mm once, came again", row.line
            )
        readings[position] = value

    def in_order(self) -> tuple[list[float], Readings]:
        """Give the positions, increasing, and each field's runs over them.

        A run that lacks a position is noted at the position's first line.
        """
        positions = sorted(self.rows)
        readings: Readings = {}
        for name, run in sorted(self.found):
            values = self.found[name, run]
            for position in positions:
                if position not in values and (name, position) not in self.wrong:
                    self.columns.text.problems.add(
                        f"expected {name} of run {run:g} at {position:g} mm, came none",
                        self.rows[position].line,
                        self._place(name),
                    )
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
    position
        Field of the position.
    names
        Fields of the readings; their cells may be empty.
    rows
        The lines.
    """
    runs = Runs(columns)
    for row, at, run in positions_and_runs(columns, position, rows):
        for name in names:
            if columns.word(row, name):
                runs.add(row, at, name, columns.number(row, name), run)
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
