"""Text of controllers' files: numbers written, lines and numbers read strictly."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Final, NamedTuple

from app.errors import InvalidContent
from app.thermal.error_map import LARGEST_ERROR_UM
from app.units import UM_PER_MM

LARGEST_ERROR_MM: Final = LARGEST_ERROR_UM / UM_PER_MM
"""A larger value in a file is something else than an error."""

FARTHEST_MM: Final = 1e6
"""Positions further out are refused [mm]."""

_NUMBER: Final = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_WHOLE: Final = re.compile(r"[+-]?\d{1,15}", re.ASCII)
_LONGEST_SHOWN: Final = 60
_MOST_CHARACTERS: Final = 4_000_000
LONGEST_LINE: Final = 1_000
"""Of a line without its comment [characters]."""

LONGEST_NUMBER: Final = 40
"""A longer word is no number that a control writes [characters]."""


class Line(NamedTuple):
    """One line of a file: its number, counted from 1, and its text without blanks around."""

    file: str
    number: int
    text: str

    def refuse(self, expected: str) -> InvalidContent:
        """Make the refusal that names file and line, what was expected and what came."""
        excerpt = self.text if len(self.text) <= _LONGEST_SHOWN else self.text[:57] + "…"
        return InvalidContent.of_field(
            f"files.{self.file}", f"line {self.number}: expected {expected}, got {excerpt!r}"
        )

    def number_of(self, text: str, what: str) -> float:
        """Read a finite decimal number, or refuse the line."""
        if len(text) > LONGEST_NUMBER or not _NUMBER.fullmatch(text):
            raise self.refuse(f"a number for {what}")
        value = float(text) + 0.0  # −0 is none
        if not math.isfinite(value):
            raise self.refuse(f"a finite number for {what}")
        return value

    def whole(self, text: str, what: str) -> int:
        """Read a whole number, or refuse the line."""
        if not _WHOLE.fullmatch(text):
            raise self.refuse(f"a whole number for {what}")
        return int(text)

    def position_mm(self, text: str) -> float:
        """Read a position [mm] within a kilometre, or refuse the line."""
        value = self.number_of(text, "a position in mm")
        if abs(value) > FARTHEST_MM:
            raise self.refuse(f"a position within ±{FARTHEST_MM:g} mm")
        return value

    def error_mm(self, text: str) -> float:
        """Read an error or compensation [mm] that a machine can have, or refuse the line."""
        value = self.number_of(text, "an error in mm")
        if abs(value) > LARGEST_ERROR_MM:
            raise self.refuse(f"an error or compensation within ±{LARGEST_ERROR_MM:g} mm")
        return value


def lines_of(file: str, content: str, comment: str | None = None) -> Iterator[Line]:
    """Go through a file's lines that say something.

    Parameters
    ----------
    comment
        What begins a comment, which is left out; None where the format has none.

    Raises
    ------
    InvalidContent
        If there are characters that no such file has.
    """
    if len(content) > _MOST_CHARACTERS:
        raise InvalidContent.of_field(
            f"files.{file}",
            f"expected at most {_MOST_CHARACTERS} characters, got {len(content)}",
        )
    for number, raw in enumerate(content.replace("\r\n", "\n").split("\n"), start=1):
        text = raw if comment is None else raw.partition(comment)[0]
        line = Line(file, number, text.strip(" \t"))
        if len(text) > LONGEST_LINE:
            raise line.refuse(f"at most {LONGEST_LINE} characters")
        # What is not printable is a control or a blank that no control knows, such as U+2028.
        if not text.replace("\t", " ").isprintable():
            raise line.refuse("text without control characters or a byte-order mark")
        if line.text:
            yield line


def fixed(value: float, decimals: int) -> str:
    """Write a number with its sign and so many decimals; there is no minus zero.

    >>> fixed(0.0001, 4), fixed(-0.00004, 4), fixed(-2100.0, 4)
    ('+0.0001', '+0.0000', '-2100.0000')
    """
    return f"{round(value, decimals) + 0.0:+.{decimals}f}"


def unsigned(value: float, decimals: int) -> str:
    """Write a number with so many decimals, without plus; there is no minus zero.

    >>> unsigned(0.0001, 4), unsigned(-0.00004, 4), unsigned(-2100.0, 2)
    ('0.0001', '0.0000', '-2100.00')
    """
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def plain(value: float, decimals: int) -> str:
    """Write a number with at most so many decimals and no more than it needs.

    >>> plain(200.0, 6), plain(-0.0105, 6), plain(-1e-9, 6)
    ('200', '-0.0105', '0')
    """
    text = unsigned(value, decimals)
    return text.rstrip("0").rstrip(".") if "." in text else text
