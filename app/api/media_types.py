"""The forms in which answers travel."""

from __future__ import annotations

from typing import Final

JSON: Final = "application/json"
HTML: Final = "text/html"
CSV: Final = "text/csv"
XLSX: Final = "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet"
ZIP: Final = "application/zip"
NPY: Final = "application/x-npy"
ARROW: Final = "application/vnd.apache.arrow.stream"

ANSWER_HEADER: Final = "Thermap-Answer"
"""What an answer in a binary form says beside its numbers, as JSON."""
