"""How large a table may be, whether it comes as text or in a workbook."""

from __future__ import annotations

from typing import Final

from app.errors import ThermapError

LONGEST_CELL: Final = 1_000
"""Of one cell [characters]: names and numbers are shorter."""

MOST_LINES: Final = 500_000
"""Of a file or a sheet, empty ones too."""

MOST_COLUMNS: Final = 1_000
MOST_CELLS: Final = 1_500_000
"""Of a whole table: its lines by its columns, whether anything stands there or not."""


class NoTable(ThermapError):
    """A workbook holds no table that could be read."""
