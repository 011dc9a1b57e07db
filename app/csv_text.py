"""Lines of CSV that no spreadsheet takes for formulas, and the way back."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable
from typing import Any, Final

_FORMULA: Final = re.compile(r"(^|[;\t\r\n])(?='*[=+@＝＋－＠-])")
"""Where a cell may begin: a semicolon or a tab parts columns where the user's locale says so."""

_MARKED: Final = re.compile(r"(^|[;\t\r\n])'(?='*[=+@＝＋－＠-])")
_NUMBER: Final = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)?(?:e[+-]?\d+)?", re.ASCII | re.I)
"""A sign alone is one too: it is a direction."""


def csv_line(cells: Iterable[Any]) -> str:
    r"""Write one line, its end with it.

    >>> csv_line(["=HYPERLINK(1)", -1.5, "-1.5", "+", "EXX"])
    "'=HYPERLINK(1),-1.5,-1.5,+,EXX\n"
    """
    text = io.StringIO()
    safe = [no_formula(cell) if isinstance(cell, str) else cell for cell in cells]
    csv.writer(text, lineterminator="\n").writerow(safe)
    return text.getvalue()


def no_formula(text: str) -> str:
    """Mark with an apostrophe, as spreadsheets do, what one would compute.

    >>> no_formula("-2+3|A1"), no_formula("a;=1+1"), no_formula("-2.5e3")
    ("'-2+3|A1", "a;'=1+1", '-2.5e3')
    """
    return text if _NUMBER.fullmatch(text) else _FORMULA.sub(r"\1'", text)


def without_marks(text: str) -> str:
    """Give the text that `no_formula` marked.

    >>> without_marks("'=x"), without_marks("'tis")
    ('=x', "'tis")
    """
    return _MARKED.sub(r"\1", text) if "'" in text else text
