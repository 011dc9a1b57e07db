"""Tables of a report: columns of words and of numbers, the first one names the row."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

NUMBER: Final = "number"
TEXT: Final = "text"
BARS: Final = "bars"
PICTURE: Final = "picture"


@dataclass(frozen=True, slots=True)
class Column:
    """One column.

    Parameters
    ----------
    title
        HTML.
    style
        What is in it.
    is_spare
        Whether a phone does without it.
    """

    title: str
    style: str = TEXT
    is_spare: bool = False

    @property
    def names(self) -> str:
        """The classes of its cells."""
        return f"{self.style} spare" if self.is_spare else self.style


def table(columns: Sequence[Column], bodies: str, *, caption: str = "") -> str:
    """Write a table that scrolls sideways where it has no room.

    Parameters
    ----------
    columns
        Its columns.
    bodies
        HTML of one or more bodies.
    caption
        HTML of what stands above it.

    Returns
    -------
    str
        HTML.
    """
    headings = "".join(f'<th scope="col" class="{c.names}">{c.title}</th>' for c in columns)
    above = f"<caption>{caption}</caption>" if caption else ""
    head = f"<thead><tr>{headings}</tr></thead>"
    return f'<div class="wide"><table>{above}{head}{bodies}</table></div>'


def body(rows: Iterable[str]) -> str:
    """Write a table's body of finished rows.

    Parameters
    ----------
    rows
        HTML of each.

    Returns
    -------
    str
        HTML.
    """
    return f"<tbody>{''.join(rows)}</tbody>"


def row(columns: Sequence[Column], cells: Sequence[str], style: str = "") -> str:
    """Write one row.

    Parameters
    ----------
    columns
        The table's columns.
    cells
        HTML of each cell; the first names the row.
    style
        Class of the row.

    Returns
    -------
    str
        HTML.
    """
    first, *rest = cells
    written = "".join(
        f'<td class="{c.names}">{cell}</td>' for c, cell in zip(columns[1:], rest, strict=True)
    )
    return f'<tr class="{style}"><th scope="row">{first}</th>{written}</tr>\n'
