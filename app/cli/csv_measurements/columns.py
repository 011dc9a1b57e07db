"""The columns of a measurement's table: found by name, read in our units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from app.cli.csv_measurements.quantities import Named, named, symbol_of
from app.cli.delimited_text import DelimitedText, Row, left_out
from app.errors import list_names


@dataclass(frozen=True, slots=True)
class Column:
    """Where a named thing stands, and in which unit."""

    thing: Named
    index: int
    unit: str

    @property
    def symbol(self) -> str:
        """The unit as people write it."""
        return symbol_of(self.unit)


@dataclass(frozen=True, slots=True)
class Columns:
    """A table's columns by the field that they hold."""

    text: DelimitedText
    by_field: Mapping[str, Column]

    def __contains__(self, field: str) -> bool:
        return field in self.by_field

    def number(self, row: Row, field: str) -> float | None:
        """Read a number in our unit; None where it is absent, empty, or wrong and noted."""
        column = self.by_field.get(field)
        if column is None:
            return None
        value = self.text.number(row, column.index, column.symbol or "counts")
        if value is None or column.thing.quantity is None:
            return value
        return column.thing.quantity.convert(value, column.unit)

    def needed(self, row: Row, field: str) -> float | None:
        """Read a number that must be there."""
        value = self.number(row, field)
        column = self.by_field[field]
        if not row.cells[column.index]:
            unit = f" in {column.symbol}" if column.unit else ""
            self.complain(row, field, f"expected {field}{unit}, came none")
        return value

    def word(self, row: Row, field: str) -> str:
        """Read a word; empty where there is none."""
        column = self.by_field.get(field)
        return row.cells[column.index] if column else ""

    def complain(self, row: Row, field: str, message: str) -> None:
        """Note a problem with a cell."""
        self.text.complain(row, self.by_field[field].index, message)


def find_columns(
    text: DelimitedText,
    needed: Sequence[Named],
    optional: Sequence[Named],
    remarks: list[str],
) -> Columns:
    """Tell the columns apart by their names.

    Parameters
    ----------
    text
        The file; what is missing, twice there or in an unknown unit is noted.
    needed, optional
        What the columns may be; names with a longer beginning in common go first.
    remarks
        Takes up which columns are not read.

    Raises
    ------
    UnreadableFile
        If the columns cannot be told apart.
    """
    things = [*needed, *optional]
    found: dict[str, Column] = {}
    others: list[int] = []
    for i, heading in enumerate(text.headings):
        match = named(things, heading)
        if match is None:
            others.append(i)
        elif match[0].field in found:
            first = text.headings[found[match[0].field].index]
            text.problems.add(
                f"expected {match[0].field} in one column, came {first} and {heading}",
                text.heading_line,
            )
        else:
            found[match[0].field] = Column(match[0], i, match[1])
    _complain_of_units(text, [t for t in things if t.field not in found], others)
    if not text.problems.found:
        _complain_of_missing(text, [t for t in needed if t.field not in found], needed, optional)
    text.problems.raise_if_any()
    unread = [text.headings[i] for i in others if text.headings[i]]
    if unread:
        remarks.append(left_out(unread))
    return Columns(text, found)


def _complain_of_units(text: DelimitedText, absent: Sequence[Named], others: list[int]) -> None:
    """Note columns that would be what is absent, but for their unit."""
    for i in others:
        heading = text.headings[i]
        for thing in absent:
            if thing.fails_by_unit(heading):
                unit = thing.unit_in(heading) or ""
                text.problems.add(thing.complaint(unit), text.heading_line, text.place(i))
                break


def _complain_of_missing(
    text: DelimitedText,
    missing: Sequence[Named],
    needed: Sequence[Named],
    optional: Sequence[Named],
) -> None:
    if missing:
        also = f" (and may be {list_names(t.full for t in optional)})" if optional else ""
        text.problems.add(
            f"expected the columns {list_names(t.full for t in needed)}{also}, without "
            f"{list_names(t.full for t in missing)} came {list_names(text.headings)}",
            text.heading_line,
        )
