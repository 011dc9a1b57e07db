"""Files as instruments write them, one format a file: the bodies of the measurements in them.

A reader takes a file's text and refuses whatever it would have to guess. To add one: a file beside
`renishaw_rtl.py`, and its line in `FORMATS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from app.files.instrument_files.renishaw_rtl import BEGINS, read_renishaw_rtl
from app.files.read_body import ReadBody


@dataclass(frozen=True, slots=True)
class InstrumentFormat:
    """One format.

    Parameters
    ----------
    method
        Whose measurement it holds, such as `positioning`.
    begins
        Whether a text is one, whatever the file's name is.
    read
        Takes the text, the file's name, and the axis where the command line states it.
    """

    name: str
    method: str
    begins: Callable[[str], bool]
    read: Callable[[str, Path, str | None], ReadBody]


FORMATS: Final[Mapping[str, InstrumentFormat]] = {
    ".rtl": InstrumentFormat(
        "Renishaw's linear .rtl",
        "positioning",
        lambda text: BEGINS.match(text) is not None,
        read_renishaw_rtl,
    ),
}
"""The suffix of its files to each format."""


def format_of_text(file: Path, text: str) -> InstrumentFormat | None:
    """Tell a text's format by its file's name, or else by how it begins."""
    by_suffix = FORMATS.get(file.suffix.lower())
    return by_suffix or next((one for one in FORMATS.values() if one.begins(text)), None)
