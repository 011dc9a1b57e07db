"""The columns of a table: found by their names, and read in our units.

Numbers are converted in decimal, so that 0.0012 mm are 1.2 µm and not 1.2 and a bit.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, tzinfo
from decimal import Decimal
from typing import Final

from app.errors import list_names, repeated
from app.files.delimited_text import DelimitedText, Message, Row, left_out
from app.units import (
    MM_PER_M,
    UM_PER_MM,
    URAD_PER_RAD,
    LacksZone,
    read_time,
    unit_of_field,
)

_SPELLINGS: Final = {
    "µ": "u",
    "μ": "u",
    "/": "_per_",
    "°c": " c",
    "°": " deg",
    "″": " arcsec",
    "′": " arcmin",
    "↑": " forward ",
    "↓": " backward ",
}

_GERMAN: Final = {
    "abweichung": "deviation",
    "achse": "axis",
    "aufspannung": "setup",
    "bezeichnung": "label",
    "fehler": "error",
    "gemessen": "measured",
    "istposition": "actual",
    "komponente": "component",
    "lauf": "run",
    "maschine": "machine",
    "messgerät": "instrument",
    "messwert": "measured",
    "richtung": "direction",
    "rückwärts": "backward",
    "sollposition": "target",
    "standardfehler": "standard_error",
    "temperatur": "temperature",
    "titel": "title",
    "vorwärts": "forward",
    "wiederholbarkeit": "repeatability",
    "zeit": "time",
}
"""Words of headings, whole ones, as they are normal here."""

_UM_PER_MM, _MM_PER_M = Decimal(UM_PER_MM), Decimal(MM_PER_M)
_URAD_PER_RAD, _RAD_PER_DEG = Decimal(URAD_PER_RAD), Decimal(math.pi) / 180
_URAD_PER_DEG = _URAD_PER_RAD * _RAD_PER_DEG
_ONE = Decimal(1)
_MM_PER_IN = Decimal("25.4")


@dataclass(frozen=True, slots=True)
class Quantity:
    """What is measured, and the units in which people state it.

    Parameters
    ----------
    unit
        Our unit, as the names of fields end in it.
    factors
        Unit as in a plain heading to its size in ours.
    assumed
        Unit of a heading that states none; without it such a heading is refused.
    """

    unit: str
    factors: Mapping[str, Decimal]
    assumed: str | None = None

    def convert(self, value: float, unit: str) -> float:
        """Turn a number in one of the units to ours, rounded once.

        >>> LENGTH.convert(0.0012, "mm"), POSITION.convert(12.5, "mm")
        (1.2, 12.5)
        """
        factor = self.factors[unit]
        return value if factor == 1 else float(Decimal(repr(value)) * factor)


LENGTH: Final = Quantity(
    "um",
    {
        "um": _ONE,
        "micron": _ONE,
        "nm": _ONE / _UM_PER_MM,
        "mm": _UM_PER_MM,
        "m": _UM_PER_MM * _MM_PER_M,
        **dict.fromkeys(("in", "inch"), _MM_PER_IN * _UM_PER_MM),
        **dict.fromkeys(("mil", "thou"), _MM_PER_IN),
        "uin": _MM_PER_IN / _UM_PER_MM,
    },
)
POSITION: Final = Quantity(
    "mm",
    {
        "mm": _ONE,
        "um": _ONE / _UM_PER_MM,
        "m": _MM_PER_M,
        **dict.fromkeys(("in", "inch"), _MM_PER_IN),
    },
)
SMALL_ANGLE: Final = Quantity(
    "urad",
    {
        "urad": _ONE,
        "um_per_m": _ONE,
        **dict.fromkeys(("ppm", "uin_per_in"), _ONE),
        "nrad": _ONE / _UM_PER_MM,
        "mrad": _URAD_PER_RAD / _MM_PER_M,
        "mm_per_m": _URAD_PER_RAD / _MM_PER_M,
        "rad": _URAD_PER_RAD,
        "arcsec": _URAD_PER_DEG / 3600,
        "arcmin": _URAD_PER_DEG / 60,
        "deg": _URAD_PER_DEG,
    },
)
ANGLE: Final = Quantity("deg", {"deg": _ONE, "rad": _ONE / _RAD_PER_DEG})
TEMPERATURE: Final = Quantity("c", {"c": _ONE, "k": _ONE, "degc": _ONE, "deg_c": _ONE})
"""Differences alone: a kelvin is as large as a degree Celsius."""


EXPANSION: Final = Quantity(
    "um_per_m_k", {"um_per_m_k": _ONE, "um_per_m_per_k": _ONE, "ppm_per_k": _ONE}
)


_ALL_UNITS: Final = {
    unit
    for quantity in (LENGTH, POSITION, SMALL_ANGLE, ANGLE, TEMPERATURE, EXPANSION)
    for unit in quantity.factors
}


@dataclass(frozen=True, slots=True)
class Named:
    """Something that a file states under one of several names.

    Parameters
    ----------
    field
        Our name without the unit.
    quantity
        What it is in; None for words and counts.
    others
        Other plain names of it.
    """

    field: str
    quantity: Quantity | None
    others: tuple[str, ...] = ()

    @property
    def full(self) -> str:
        """Our name with the unit, as the names of fields are."""
        return f"{self.field}_{self.quantity.unit}" if self.quantity else self.field

    def unit_in(self, heading: str) -> str | None:
        """Read the unit from a heading; None where the heading names something else.

        What follows one of the names is returned whether it is a known unit or not;
        a heading that states no unit gives an empty text.

        >>> linear = Named("linear", LENGTH)
        >>> linear.unit_in("Linear [mm]"), linear.unit_in("linear"), linear.unit_in("x_um")
        ('mm', '', None)
        """
        plain = normal_heading(heading)
        for name in sorted((self.field, *self.others), key=len, reverse=True):
            if plain == name:
                return ""
            if plain.startswith(f"{name}_"):
                return plain.removeprefix(f"{name}_")
        return None

    def known(self, unit: str) -> str | None:
        """Give the unit to convert from, "" for words and counts; None where it is unknown."""
        if self.quantity is None:
            return unit if unit == "" else None
        if unit == "":
            return self.quantity.assumed
        return unit if unit in self.quantity.factors else None

    def fails_by_unit(self, heading: str) -> bool:
        """Say whether a heading names this, but in no unit or in one that nobody knows.

        `linear_error_of_x_um` is something else; `linear [furlong]` is not.
        """
        unit = self.unit_in(heading)
        if self.quantity is None or unit is None or self.known(unit) is not None:
            return False
        return "_" not in unit or bool(re.search(r"[\[(]", heading)) or unit in _ALL_UNITS

    def complaint(self, unit: str) -> str:
        """Say what was expected in place of a unit that is none."""
        units = list(self.quantity.factors) if self.quantity else []
        got = f"the unit {unit!r}" if unit else "no unit"
        return (
            f"expected the unit of {self.field} in the name, such as {self.full} "
            f"({list_names(units)}), got {got}"
        )


def symbol_of(unit: str) -> str:
    """Write a unit as people do.

    >>> symbol_of("um"), symbol_of("furlong")
    ('µm', 'furlong')
    """
    return unit_of_field(f"_{unit}") or unit


def normal_heading(heading: str) -> str:
    """Write a heading in one way: small letters, units in ASCII after an underscore.

    >>> normal_heading("Angle [°]"), normal_heading("run 1 ↑ [µm]"), normal_heading("error_um/m")
    ('angle_deg', 'run_1_forward_um', 'error_um_per_m')
    >>> normal_heading("Fehler rückwärts [µm]")
    'error_backward_um'
    """
    plain = heading.lower()
    for sign, word in _SPELLINGS.items():
        plain = plain.replace(sign, word)
    words = re.split(r"[\s\[\]()_]+", plain)
    return "_".join(_GERMAN.get(word, word) for word in words if word)


def named(things: Iterable[Named], heading: str) -> tuple[Named, str] | None:
    """Find what a heading names, with its known unit."""
    for thing in things:
        unit_text = thing.unit_in(heading)
        unit = None if unit_text is None else thing.known(unit_text)
        if unit is not None:
            return thing, unit
    return None


@dataclass(frozen=True, slots=True)
class _Nameable:
    """Things by their names: a table of as many things as columns is not searched for each."""

    by_name: Mapping[str, Sequence[tuple[int, Named]]]

    @classmethod
    def of(cls, things: Iterable[Named]) -> _Nameable:
        """Sort things, which keep their order."""
        by_name: dict[str, list[tuple[int, Named]]] = {}
        for order, thing in enumerate(things):
            for name in {thing.field, *thing.others}:
                by_name.setdefault(name, []).append((order, thing))
        return cls(by_name)

    def by(self, heading: str) -> list[Named]:
        """List those one of whose names a heading begins with."""
        plain = f"{normal_heading(heading)}_"
        ends = [i for i, letter in enumerate(plain) if letter == "_"]
        begun = {order: thing for i in ends for order, thing in self.by_name.get(plain[:i], ())}
        return [begun[order] for order in sorted(begun)]


@dataclass(frozen=True, slots=True)
class Column:
    """Where a named thing stands, and in which unit."""

    thing: Named
    unit: str
    index: int

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
            self.complain(row, field, f"expected {field}{unit}, got none")
        return value

    def word(self, row: Row, field: str) -> str:
        """Read a word; empty where there is none."""
        column = self.by_field.get(field)
        return row.cells[column.index] if column else ""

    def moment(
        self, row: Row, field: str, zone: tzinfo | None = None, remedy: str = ""
    ) -> datetime | None:
        """Read a time with its zone; None where it is wrong and noted.

        Parameters
        ----------
        zone
            Of a time that states none.
        remedy
            What to say beside that a zone is missing.
        """
        written = self.word(row, field)
        try:
            return read_time(written, zone)
        except LacksZone:
            in_utc, in_zone = f"{written}Z", f"{written}+01:00"
            self.complain(
                row,
                field,
                f"expected a time with its zone, such as {in_utc} or {in_zone}, "
                f"got {written!r}{remedy}",
            )
        except ValueError:
            self.complain(
                row,
                field,
                f"expected a time such as 2026-03-01T06:00:00Z, from the year 1900 to 2999, "
                f"got {written!r}",
            )
        return None

    def complain(self, row: Row, field: str, message: Message) -> None:
        """Note a problem with a cell, or with the line where there is no such column."""
        column = self.by_field.get(field)
        if column is None:
            self.text.problems.add(message, row.line)
        else:
            self.text.complain(row, column.index, message)


def match_columns(text: DelimitedText, things: Iterable[Named]) -> list[Column]:
    """List the columns that hold one of some things in a known unit, as they stand.

    Names with a longer beginning in common go first; two columns may hold the same thing.
    """
    nameable = _Nameable.of(things)
    return [
        Column(*match, index)
        for index, heading in enumerate(text.headings)
        if (match := named(nameable.by(heading), heading))
    ]


def has_column(text: DelimitedText, thing: Named) -> bool:
    """Say whether a column is called so, in whatever unit."""
    return bool(match_columns(text, (thing,))) or any(map(thing.fails_by_unit, text.headings))


def by_field(text: DelimitedText, columns: Iterable[Column]) -> dict[str, Column]:
    """Sort columns by their field; one that stands there twice is noted."""
    first_columns: dict[str, Column] = {}
    for column in columns:
        field = column.thing.field
        first = first_columns.setdefault(field, column)
        if first is not column:
            text.problems.add(
                f"expected {field} in one column, got {text.headings[first.index]} and "
                f"{text.headings[column.index]}",
                text.heading_line,
            )
    return first_columns


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
    matches = match_columns(text, things)
    by_field_name = by_field(text, matches)
    read = {column.index for column in matches}
    others = [i for i in range(len(text.headings)) if i not in read]
    _complain_of_units(text, [t for t in things if t.field not in by_field_name], others)
    if not text.problems.number:
        _complain_of_missing(
            text, [t for t in needed if t.field not in by_field_name], needed, optional
        )
    text.problems.raise_if_any()
    unread = [text.headings[i] for i in others if text.headings[i]]
    if unread:
        remarks.append(left_out(unread))
    return Columns(text, by_field_name)


def _complain_of_units(text: DelimitedText, absent: Sequence[Named], others: list[int]) -> None:
    """Note columns that would be what is absent, but for their unit."""
    nameable = _Nameable.of(absent)
    for i in others:
        heading = text.headings[i]
        for thing in nameable.by(heading):
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
            f"{list_names(t.full for t in missing)} got {list_names(text.headings)}",
            text.heading_line,
        )


def name_after(word: str, heading: str) -> str:
    """Read what a heading names after a word; empty where it is something else.

    >>> name_after("state", "state spindle_rpm"), name_after("state", "State: coolant")
    ('spindle_rpm', 'coolant')
    >>> name_after("state", "statement")
    ''
    """
    begins, rest = heading[: len(word)], heading[len(word) :]
    if begins.lower() != word or not rest or rest[0].isalnum():
        return ""
    return rest.strip(" :._[]")


def names_after(text: DelimitedText, word: str) -> dict[int, str]:
    """Find the columns that begin with a word, and what each names; one named twice is noted."""
    names = {i: name for i, h in enumerate(text.headings) if (name := name_after(word, h))}
    twice = repeated(names.values())
    if twice:
        text.problems.add(
            f"expected each {word} in one column, got {list_names(twice)} again", text.heading_line
        )
    return names
