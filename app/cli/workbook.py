"""An Excel workbook as the text that it would be, saved as CSV: one line for each row."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from datetime import datetime
from typing import Any, Final

from app.errors import ThermapError, list_names

WORKBOOK: Final = b"PK\x03\x04"
"""How a workbook (.xlsx) begins, as every zip file does."""

OLD_WORKBOOK: Final = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
"""How a workbook of Excel 97 to 2003 (.xls) begins."""


class NoTable(ThermapError):
    """A workbook holds no table that could be read."""


def workbook_text(content: bytes) -> str:
    """Write the sheet that holds values as text with tabs between the columns.

    Parameters
    ----------
    content
        The whole file.

    Returns
    -------
    str
        A line for each row, as they are numbered in the sheet; formulas as their values.

    Raises
    ------
    NoTable
        If it is no workbook, or not exactly one sheet holds something.
    """
    if content.startswith(OLD_WORKBOOK):
        raise NoTable("an old Excel workbook (.xls): save it as CSV or .xlsx")
    from openpyxl import load_workbook

    try:
        book = load_workbook(io.BytesIO(content), read_only=True, data_only=True)
        all_rows = {s.title: [_cells(row) for row in s.values] for s in book.worksheets}
    except Exception as error:  # openpyxl lets through whatever its XML and zip readers raise
        raise NoTable(f"expected CSV or an Excel workbook (.xlsx), came neither: {error}") from None
    sheets = {title: rows for title, rows in all_rows.items() if any(rows)}
    if len(sheets) != 1:
        came = f"{len(sheets)}: {list_names(sheets)}" if sheets else "none"
        raise NoTable(
            f"an Excel workbook: expected one sheet that holds values, came {came}; "
            "keep one, or save the one that is meant as CSV"
        )
    (rows,) = sheets.values()
    return "".join(_line(cells) for cells in rows)


def _cells(row: Sequence[Any]) -> list[str]:
    """Write a row's cells, without the empty ones at its end."""
    cells = [_written(value) for value in row]
    while cells and not cells[-1]:
        cells.pop()
    return cells


def _written(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, datetime):
        return value.isoformat()
    return " ".join(str(value).split())


def _line(cells: Sequence[str]) -> str:
    """Write one line; a comment may go over several cells."""
    if cells and cells[0].startswith("#"):
        return " ".join(cells) + "\n"
    if not cells:
        return "\n"
    text = io.StringIO()
    csv.writer(text, delimiter="\t", quoting=csv.QUOTE_ALL, lineterminator="\n").writerow(cells)
    return text.getvalue()
