"""The comment lines above a table: whose, when, at which temperatures, and a method's own."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from app.decimal_text import read_number
from app.errors import ThermapError, list_names
from app.files.code_pages import UNREADABLE
from app.files.csv_columns import LENGTH, Named, named, normal_heading, symbol_of
from app.files.delimited_text import Comment, DelimitedText, Problems
from app.units import read_time

_KEYS: Final = "label, measured_at, machine, temperature SENSOR, instrument, repeatability_um"

_WORDS: Final = ("label", "machine", "instrument", "measured_at")
"""What every table may state in words."""

_TEMPERATURE: Final = re.compile(r"(?:temperature?|temperature_c)\s+(?P<sensor>\S.*)", re.I)
_REPEATABILITY: Final = Named("repeatability", LENGTH)
_MARKS: Final = ":=;\t,"
"""Behind the name of what is stated; those of cells too, whatever parts the table's columns."""

CELSIUS: Final = ("°c", "° c", "degc", "deg c", "celsius")
"""How people write the unit of temperatures."""


_OF_A_MAP: Final = {
    "label": ("a label", "# label: Run #1", "--label"),
    "measured_at": ("a time with its zone", "# measured_at: 2026-03-01T06:00:00Z", "--measured-at"),
    "temperatures_c": (
        "every sensor's temperature in °C",
        "# temperature x-middle: 20.1",
        "--temperature",
    ),
}
"""What a map needs: in words, as a comment line, and as an option."""

MOST_FREE: Final = 5
"""Comment lines of free text that are named as not read."""

_SEPARATOR: Final = re.compile(r"\s*;\s*|,\s+|\s+")


@dataclass(frozen=True, slots=True)
class Header:
    """What is said of a map beside its file; it takes precedence over what the file says."""

    label: str | None = None
    measured_at: str | None = None
    temperatures_c: Mapping[str, float] = field(default_factory=dict)
    axis: str | None = None


@dataclass(frozen=True, slots=True)
class Statement:
    """One `# key: value` line that a method reads.

    Parameters
    ----------
    shape
        Numbers in it; 0 for a word.
    needed
        Whether the method cannot do without.
    word
        Turns a word to what the method wants, or raises with what was expected.
    """

    thing: Named
    shape: int
    example: str
    needed: bool = False
    word: Callable[[str], Any] = str


@dataclass(frozen=True, slots=True)
class Comments:
    """What the comment lines say.

    Parameters
    ----------
    state
        Label, time, temperatures, instrument and repeatability, as far as stated.
    statements
        Fields of the method, in our units.
    """

    state: dict[str, Any]
    statements: dict[str, Any]
    machine: str | None


def read_comments(
    text: DelimitedText,
    header: Header,
    remarks: list[str],
    method_statements: Sequence[Statement] = (),
    *,
    complete: bool = True,
    is_dated: bool = False,
) -> Comments:
    """Read `# key: value` lines, and complain of what is wrong or missing.

    Parameters
    ----------
    text
        The file; what is wrong or missing is noted in its problems.
    header
        What takes precedence over the file's lines.
    remarks
        Takes up which lines are not read.
    method_statements
        What a method reads beside label, time and temperatures.
    complete
        Whether label, time and temperatures are needed, as for storing a map.
    is_dated
        Whether the table's lines state times and temperatures, so that a label is enough.
    """
    statements: dict[str, Any] = {}
    facts: dict[str, Any] = {}
    temperatures_c: dict[str, float] = {}
    empty: dict[str, int] = {}
    names = [one.thing.full for one in method_statements if one.thing.full not in _KEYS.split(", ")]
    also = f"; of this method: {list_names(names)}" if names else ""
    free: list[str] = []
    for comment in text.comments:
        line = comment.line
        text.problems.sheet = comment.sheet
        split = _name_and_value(comment, method_statements)
        if split is None:
            free += [comment.text] if comment.text else []
            continue
        name, value = split
        if UNREADABLE in name + value:
            text.problems.add(
                f"expected text in UTF-8, got letters of an unknown code page in {comment.text!r}",
                line,
            )
            continue
        statement = _statement_of(method_statements, name)
        if statement is None:
            if not _read_fact(text.problems, line, name, value, facts, temperatures_c, empty):
                remarks.append(f"line {line}: {name!r} is not read; what is: {_KEYS}{also}")
        elif statement.thing.full in statements:
            text.problems.add(f"expected {statement.thing.full} once, came again", line)
        else:
            statements[statement.thing.full] = _value(text.problems, statement, line, name, value)
    text.problems.sheet = ""
    if free:
        remarks.append(f"comment lines that are not read: {list_names(map(repr, free), MOST_FREE)}")
    if header.axis is not None and any(one.thing.full == "axis" for one in method_statements):
        statements["axis"] = header.axis
    for statement in method_statements:
        if statement.needed and statement.thing.full not in statements:
            how = f": write `# {statement.example}`"
            text.problems.lack(
                statement.thing.full, f"expected {statement.thing.field}, got none", how
            )
    noted = facts | ({"temperatures_c": temperatures_c} if temperatures_c else {})
    facts = with_stated(noted, header)
    if complete:
        for sensor, line in empty.items():
            if not is_dated and sensor not in header.temperatures_c:
                message = f"expected the temperature of {sensor} in °C, got none"
                text.problems.lack(f"temperatures_c.{sensor}", message, line=line)
        noted = {"temperatures_c": empty} if empty else {}
        complain_of_missing(facts | noted, text.problems, is_dated=is_dated)
    if written := facts.get("measured_at"):
        try:
            facts["measured_at"] = read_time(written).isoformat().replace("+00:00", "Z")
        except ValueError:
            text.problems.lack(
                "measured_at",
                f"expected measured_at with its zone such as 2026-03-01T06:00:00Z, got {written!r}",
            )
    machine = facts.pop("machine", None)
    return Comments(facts, statements, machine)


def _name_and_value(comment: Comment, statements: Sequence[Statement]) -> tuple[str, str] | None:
    """Part what a line states from its value: where the next cell begins, or at a mark.

    Of these the first whose name is known; None where a line states nothing, as free text does.
    """
    first, *others = comment.cells or [""]
    ways = [_parted(comment.text, mark) for mark in _MARKS if mark in comment.text]
    if others:
        cells = (first, " ".join(others))
        if first.lower() in ("temperatur", "temperature", "temperature_c"):
            cells = (f"{first} {others[0]}", " ".join(others[1:]))
        ways.insert(":" in first, cells)
    if not any(_is_known(name, statements) for name, _ in ways):
        return ways[0] if ways and ":" in comment.text else None
    return next(way for way in ways if _is_known(way[0], statements))


def _parted(text: str, mark: str) -> tuple[str, str]:
    name, _, value = text.partition(mark)
    return " ".join(name.split()), " ".join(value.split())


def _is_known(name: str, statements: Sequence[Statement]) -> bool:
    return _statement_of(statements, name) is not None or _is_fact(name)


def _is_fact(name: str) -> bool:
    """Say whether a name is one of what every table may state."""
    return (
        normal_heading(name) in _WORDS
        or _TEMPERATURE.fullmatch(name) is not None
        or _REPEATABILITY.unit_in(name) is not None
    )


def _read_fact(
    problems: Problems,
    line: int,
    name: str,
    value: str,
    facts: dict[str, Any],
    temperatures_c: dict[str, float],
    empty: dict[str, int],
) -> bool:
    """Read a line that every table may have; say whether it is one.

    One that was not filled in states nothing; sensors' are put into `empty` with their line.
    """
    if not _is_fact(name):
        return False
    of_sensor = _TEMPERATURE.fullmatch(name)
    if of_sensor and not value:
        empty[of_sensor["sensor"]] = line
    elif of_sensor:
        sensor = of_sensor["sensor"]
        number = read_number(without_unit(value, (*CELSIUS, "c")))
        if number is None:
            problems.add(f"expected the temperature of {sensor} in °C, got {value!r}", line)
        else:
            what = f"the temperature of {sensor}"
            _note_once(problems, line, temperatures_c, sensor, number, what)
    elif normal_heading(name) in _WORDS:
        if value:
            _note_once(problems, line, facts, normal_heading(name), value)
    else:
        statement = Statement(_REPEATABILITY, 1, "repeatability_um: 0.5")
        number = _value(problems, statement, line, name, value)
        if number is not None:
            _note_once(problems, line, facts, _REPEATABILITY.full, number)
    return True


def _note_once(
    problems: Problems, line: int, noted: dict[str, Any], name: str, value: object, what: str = ""
) -> None:
    """Note what a line states; sheets may repeat their head, but not say otherwise in it."""
    if noted.setdefault(name, value) != value:
        problems.add(f"expected {what or name} once, got {noted[name]} and {value}", line)


def with_stated(facts: Mapping[str, Any], stated: Header) -> dict[str, Any]:
    """Let what is stated beside a file take precedence over what it says."""
    found = dict(facts)
    found |= {k: v for k in ("label", "measured_at") if (v := getattr(stated, k)) is not None}
    if stated.temperatures_c:
        known = found.get("temperatures_c")
        of_file = known if isinstance(known, Mapping) else {}
        found["temperatures_c"] = {**of_file, **stated.temperatures_c}
    return found


def complain_of_missing(
    facts: Mapping[str, Any], problems: Problems, *, is_dated: bool, has_comments: bool = True
) -> None:
    """Note what a map still lacks.

    Parameters
    ----------
    is_dated
        Whether the readings have times and temperatures of their own.
    has_comments
        Whether it may be written into comment lines of the file.
    """
    for key in ("label",) if is_dated else _OF_A_MAP:
        what, comment, option = _OF_A_MAP[key]
        if not facts.get(key):
            where = f"write `{comment}`" if has_comments else "state it"
            problems.lack(key, f"expected {what}, got none", f": {where} or give {option}")


def _statement_of(statements: Sequence[Statement], key: str) -> Statement | None:
    """Find the statement of a key; one in an unknown unit is found too, to be refused."""
    match = named([one.thing for one in statements], key)
    for statement in statements:
        if (match and statement.thing == match[0]) or (
            not match and statement.thing.fails_by_unit(key)
        ):
            return statement
    return None


def _value(problems: Problems, statement: Statement, line: int, key: str, value: str) -> Any:
    """Read a value; what is wrong is noted and None is returned."""
    if statement.shape == 0:
        try:
            return statement.word(value)
        except ThermapError as error:
            problems.add(error.detail, line)
            return None
    value, unit = _without_unit(statement.thing, key, value)
    if statement.thing.known(unit) is None:
        problems.add(statement.thing.complaint(unit), line)
        return None
    numbers = [read_number(part) for part in _parts(value, statement.shape)]
    if len(numbers) != statement.shape or None in numbers:
        what = "a number" if statement.shape == 1 else f"{statement.shape} numbers"
        such = f"{symbol_of(unit)} such as `# {statement.example}`"
        problems.add(f"expected {what} in {such}, got {value!r}", line)
        return None
    convert = (
        statement.thing.quantity.convert if statement.thing.quantity else lambda number, _: number
    )
    ours = [convert(number, unit) for number in numbers if number is not None]
    return ours[0] if statement.shape == 1 else ours


def _without_unit(thing: Named, key: str, value: str) -> tuple[str, str]:
    """Take the unit off a value where its name states none, or the same one.

    >>> _without_unit(_REPEATABILITY, "repeatability", "0.5 µm")
    ('0.5', 'um')
    """
    unit = thing.unit_in(key) or ""
    digits = max((i for i, letter in enumerate(value, start=1) if letter.isdigit()), default=0)
    behind = normal_heading(value[digits:].strip(" .,;"))
    if digits and behind and unit in ("", behind):
        return value[:digits], behind
    return value, unit


def without_unit(text: str, units: Sequence[str]) -> str:
    """Take one of some units off the end of a text, and brackets around it.

    >>> without_unit("20.1 °C", CELSIUS), without_unit("Bed [°C]", CELSIUS)
    ('20.1', 'Bed')
    """
    bare = text.rstrip(" ])")
    of_text = next((unit for unit in units if bare.lower().endswith(unit)), None)
    return text if of_text is None else bare[: -len(of_text)].rstrip(" [(")


def _parts(value: str, count: int) -> list[str]:
    """Part a list of numbers at semicolons, blanks, or commas where they are no decimal ones."""
    if count == 1:
        return [value]
    parts = [part for part in _SEPARATOR.split(value.strip()) if part]
    return value.split(",") if len(parts) == 1 else parts
