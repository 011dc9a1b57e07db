"""Tables of a report: columns of words and of numbers, the first one names the row."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from app.identification.residuals import LeftOut
from app.pages.report_parts.words import sentence

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
    width_percent
        Share of the table's width, where several tables are to stand in line; 0: as needed.
    """

    title: str
    style: str = TEXT
    width_percent: int = 0


def table(columns: Sequence[Column], bodies: str, *, caption: str = "", unit: str = "") -> str:
    """Write a table that scrolls sideways where it has no room.

    Parameters
    ----------
    columns
        Its columns.
    bodies
        HTML of one or more bodies.
    caption
        HTML of what stands above it.
    unit
        HTML of a line below the headings, repeated with them on each page.

    Returns
    -------
    str
        HTML.
    """
    headings = "".join(map(_heading, columns))
    above = f"<caption>{caption}</caption>" if caption else ""
    below = (
        f'<tr class="unit"><th scope="colgroup" colspan="{len(columns)}">{unit}</th></tr>'
        if unit
        else ""
    )
    head = f"<thead><tr>{headings}</tr>{below}</thead>"
    return f'<div class="wide"><table>{above}{head}{bodies}</table></div>'


def _heading(column: Column) -> str:
    wide = f' style="width: {column.width_percent}%"' if column.width_percent else ""
    return f'<th scope="col" class="{column.style}"{wide}>{column.title}</th>'


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
        f'<td class="{c.style}">{cell}</td>' for c, cell in zip(columns[1:], rest, strict=True)
    )
    return f'<tr class="{style}"><th scope="row">{first}</th>{written}</tr>\n'


def reasons_table(left_out: Iterable[LeftOut]) -> str:
    """Write why values were left out, and how many.

    Parameters
    ----------
    left_out
        What took no part.

    Returns
    -------
    str
        HTML.
    """
    columns = (Column("reason"), Column("values", NUMBER))
    rows = body(row(columns, [sentence(one.reason), str(one.count)]) for one in left_out)
    return f'<div class="narrow">{table(columns, rows)}</div>'
