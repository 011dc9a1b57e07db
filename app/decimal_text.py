"""Numbers as people write them."""

from __future__ import annotations

import math
import re
from typing import Final

LONGEST_NUMBER: Final = 40
"""A longer text is no number that anybody wrote [characters]."""

_NUMBER: Final = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)


def read_number(text: str, *, decimal_comma: bool = True) -> float | None:
    """Read a finite decimal number as people write it, or None where it is something else.

    >>> read_number(" 24,1 "), read_number("−3.5"), read_number("nan"), read_number("1_0")
    (24.1, -3.5, None, None)
    >>> read_number("1e999"), read_number("２０"), read_number("-0,0")
    (None, None, 0.0)
    """
    written = text.strip()
    if len(written) > LONGEST_NUMBER:
        return None
    written = written.replace("\N{MINUS SIGN}", "-")
    if decimal_comma and "." not in written:
        written = written.replace(",", ".")
    number = float(written) if _NUMBER.fullmatch(written) else math.inf
    return number + 0.0 if math.isfinite(number) else None  # −0 is none
