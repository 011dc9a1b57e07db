"""An error map from a file that came over HTTP."""

from __future__ import annotations

from pathlib import Path

from app.api.files.csv_comments import Stated
from app.api.files.csv_error_map import CsvErrorMap, parse_csv_error_map
from app.api.files.delimited_text import UnreadableFile, text_of
from app.api.files.instrument_files import format_of_text
from app.errors import FieldError, InvalidContent


def read_uploaded_map(content: bytes, name: str, machine: str, stated: Stated) -> CsvErrorMap:
    """Read an error map from what is in a file, CSV or an Excel workbook.

    Parameters
    ----------
    name
        The file's name, under which complaints stand.
    machine
        The machine that it is for.
    stated
        What takes precedence over the file's own comment lines.

    Raises
    ------
    InvalidContent
        With an entry, under `file`, for everything that is wrong in the words of the command
        line: line, column, what was expected and what came; if an instrument wrote it, whose
        readings make no map by themselves; if it is another machine's.
    """
    file = Path(Path(name).name or "file.csv")
    try:
        text = text_of(content, file)
        written = format_of_text(file, text)
        if written is not None:
            raise UnreadableFile(
                f"{file}: expected an error map as CSV, got {written.name}, a measurement by "
                f"{written.method}: `thermap import` reads it"
            )
        found = parse_csv_error_map(text, file, stated)
    except UnreadableFile as error:
        lines = error.detail.splitlines()
        raise InvalidContent(error.detail, [FieldError("file", line) for line in lines]) from None
    if found.machine not in (None, machine):
        raise InvalidContent.of_field(
            "file",
            f"{file}: expected a map of machine {machine!r}, got one that says that it is of "
            f"{found.machine!r}",
        )
    return found
