"""What a measurement's file is: the comment lines and columns of a method, and its body."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from app.cli.csv_measurements.comments import Statement
from app.cli.csv_measurements.quantities import LENGTH, POSITION, SMALL_ANGLE, Named
from app.cli.delimited_text import DelimitedText
from app.errors import InvalidContent, list_names

Body = dict[str, Any]
"""Fields of `POST …/measurements/{method}`, without label, time and temperatures."""

ReadBody = Callable[[DelimitedText, Mapping[str, Any], list[str]], Body]
"""Takes the file, what its comment lines state, and the list of remarks."""


@dataclass(frozen=True, slots=True)
class Format:
    """A method's file.

    Parameters
    ----------
    statements
        The comment lines that it reads beside label, time and temperatures.
    read
        Makes the body of the columns.
    """

    statements: tuple[Statement, ...]
    read: ReadBody


RUN: Final = Named("run", None, ("cycle",))

REPEATABILITY: Final = Statement(Named("repeatability", LENGTH), 1, "repeatability_um: 0.5")
REPEATABILITY_OF_ANGLES: Final = Statement(
    Named("repeatability", SMALL_ANGLE), 1, "repeatability_urad: 0.5"
)
TOOL_OFFSET: Final = Statement(Named("tool_offset", POSITION), 3, "tool_offset_mm: 0, 0, 160")
MEASURING_LINE: Final = Statement(
    Named("measuring_line", POSITION), 3, "measuring_line_mm: 0, 250, 100"
)


def word_among(what: str, *words: str) -> Callable[[str], str]:
    """Make a reader of one of some words, in any case of letters."""

    def read(text: str) -> str:
        found = [word for word in words if word.lower() == text.lower()]
        if not found:
            raise InvalidContent(f"expected {what} among {list_names(words)}, came {text!r}")
        return found[0]

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
