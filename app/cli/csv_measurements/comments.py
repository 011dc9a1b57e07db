"""The comment lines above a measurement: its thermal state, and what the table cannot say."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from app.cli.csv_comments import Stated, read_comments
from app.cli.csv_measurements.quantities import Named, named, symbol_of
from app.cli.delimited_text import DelimitedText, Problems
from app.cli.options import read_number
from app.errors import ThermapError, list_names

_SEPARATOR: Final = re.compile(r"\s*;\s*|,\s+|\s+")


@dataclass(frozen=True, slots=True)
class Statement:
    """One `# key: value` line that a method reads.

    Parameters
    ----------
    thing
        Its key.
    shape
        Numbers in it; 0 for a word.
    needed
        Whether the method cannot do without.
    example
        For messages.
    word
        Turns a word to what the method wants, or raises with what was expected.
    """

    thing: Named
    shape: int
    example: str
    needed: bool = False
    word: Callable[[str], str] = str


@dataclass(frozen=True, slots=True)
class Comments:
    """What the comment lines say.

    Parameters
    ----------
    state
        Label, time, temperatures and instrument, as far as stated.
    statements
        Fields of the method, in our units.
    machine
        The machine that the file names.
    """

    state: dict[str, Any]
    statements: dict[str, Any]
    machine: str | None


def read_measurement_comments(
    text: DelimitedText,
    known: Sequence[Statement],
    stated: Stated,
    complete: bool,
    remarks: list[str],
) -> Comments:
    """Read the comment lines, and complain of what is wrong or missing.

    Parameters
    ----------
    text
        The file; problems are noted in it.
    known
        What the method reads.
    stated
        What goes before the file's lines.
    complete
        Whether label, time and temperatures are needed, as for storing a map.
    remarks
        Takes up which lines are not read.
    """
    statements: dict[str, Any] = {}
    rest: list[tuple[int, str]] = []
    for line, comment in text.comments:
        key, colon, value = (part.strip() for part in comment.partition(":"))
        one = _statement_of(known, key) if colon else None
        if one is None:
            rest.append((line, comment))
        elif one.thing.full in statements:
            text.problems.add(f"expected {one.thing.full} once, came again", line)
        else:
            statements[one.thing.full] = _value(text.problems, one, line, key, value)
    for one in known:
        if one.needed and one.thing.full not in statements:
            text.problems.add(f"expected {one.thing.field}, came none: write `# {one.example}`")
    before = len(remarks)
    state = read_comments(replace(text, comments=rest), stated, remarks, complete)
    also = f"; of this method: {list_names(one.thing.full for one in known)}"
    remarks[before:] = [f"{remark}{also}" for remark in remarks[before:]]
    machine = state.pop("machine", None)
    return Comments(state, statements, machine)


def _statement_of(known: Sequence[Statement], key: str) -> Statement | None:
    """Find the statement of a key; one in an unknown unit is found too, to be refused."""
    match = named([one.thing for one in known], key)
    for one in known:
        if (match and one.thing == match[0]) or (not match and one.thing.fails_by_unit(key)):
            return one
    return None


def _value(problems: Problems, one: Statement, line: int, key: str, value: str) -> Any:
    """Read a value; what is wrong is noted and None is returned."""
    if one.shape == 0:
        try:
            return one.word(value)
        except ThermapError as error:
            problems.add(error.detail, line)
            return None
    unit = one.thing.unit_in(key) or ""
    if not one.thing.knows(unit):
        problems.add(one.thing.complaint(unit), line)
        return None
    numbers = [read_number(part) for part in _parts(value, one.shape)]
    if len(numbers) != one.shape or None in numbers:
        what = "a number" if one.shape == 1 else f"{one.shape} numbers"
        such = f"{symbol_of(unit)} such as `# {one.example}`"
        problems.add(f"expected {what} in {such}, came {value!r}", line)
        return None
    convert = one.thing.quantity.convert if one.thing.quantity else lambda number, _: number
    ours = [convert(number, unit) for number in numbers if number is not None]
    return ours[0] if one.shape == 1 else ours


def _parts(value: str, count: int) -> list[str]:
    """Part a list of numbers at semicolons, blanks, or commas where they are no decimal ones."""
    if count == 1:
        return [value]
    parts = [part for part in _SEPARATOR.split(value.strip()) if part]
    return value.split(",") if len(parts) == 1 else parts
