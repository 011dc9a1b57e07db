"""What a file holds, wherever it was sent: an error map, or a check."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import Any, Final

from app.errors import InvalidContent
from app.files.component_sheets import read_component_sheets
from app.files.csv_columns import normal_heading
from app.files.csv_error_map import has_error_columns
from app.files.csv_verification import has_measured_columns
from app.files.delimited_text import (
    Problems,
    UnreadableFile,
    only_sheet,
    parse_delimited,
    sheets_of,
)
from app.files.instrument_files import format_of_text
from app.json_text import NoJsonError, RepeatedNameError, read_json


class FileKind(StrEnum):
    """What a file holds that a machine's model is made of, or held against."""

    MAP = "map"
    CHECK = "check"

    @property
    def words(self) -> str:
        """With its article."""
        return _WORDS[self]


_WORDS: Final = {
    FileKind.MAP: "an error map",
    FileKind.CHECK: "check measurements with their times",
}
_COMMANDS: Final = {
    FileKind.MAP: "`thermap import {}` makes a map of it",
    FileKind.CHECK: "`thermap verifications store {}` stores them",
}
_TIMES: Final = frozenset({"time", "setup"})
"""Columns that checks have beside those of components, and maps do not."""


def kind_of_file(content: bytes, file: Path) -> FileKind | None:
    """Tell by its columns, or by the names in its JSON, what a file holds; None if they do not say.

    What else is wrong with it does not matter.
    """
    try:
        if is_json(content, file):
            return _kind_of_json(read_json(content))
        sheets = sheets_of(content, file)
        if format_of_text(file, next(iter(sheets.values()), "")) is not None:
            return FileKind.MAP
        return _kind_of_sheets(sheets, file)
    except (UnreadableFile, NoJsonError, RepeatedNameError):
        return None


def _kind_of_json(document: Any) -> FileKind | None:
    entry = document[0] if isinstance(document, list) and document else document
    if not isinstance(entry, dict):
        return None
    if "observations" in entry:
        return FileKind.CHECK
    return FileKind.MAP if "components" in entry else None


def _kind_of_sheets(sheets: Mapping[str, str], file: Path) -> FileKind | None:
    problems = Problems(file)
    tables = read_component_sheets(sheets, problems, [])
    if tables is None:
        text = parse_delimited(only_sheet(sheets, file), problems)
        if has_measured_columns(text):
            return FileKind.CHECK
        return FileKind.MAP if has_error_columns(text) else None
    if tables.headings & _TIMES:
        return FileKind.CHECK
    names = {normal_heading(comment.text.partition(":")[0]) for comment in tables.header.comments}
    # One time for all values may be that of either; a check needs one, and no temperatures.
    has_temperatures = any(name.startswith("temperature") for name in names)
    return FileKind.MAP if has_temperatures or "measured_at" not in names else None


def is_json(content: bytes, file: Path) -> bool:
    """Whether a file is JSON, by its name or by how it begins."""
    return file.suffix.lower() == ".json" or content.lstrip()[:1] == b"{"


def json_of(content: bytes, problems: Problems) -> Any:
    """Read JSON within the limits of what is sent.

    Raises
    ------
    UnreadableFile
        If it is none, or an object has a name twice.
    """
    try:
        return read_json(content)
    except (NoJsonError, RepeatedNameError) as error:
        problems.add(f"expected JSON, got none: {error}")
    problems.raise_if_any()
    return None


def refuse_other_kind(expected: FileKind, content: bytes, file: Path) -> None:
    """Say of a file that could not be read as expected that it holds the other kind.

    Raises
    ------
    InvalidContent
        If it does.
    """
    kind = kind_of_file(content, file)
    if kind is None or kind is expected:
        return
    command = _COMMANDS[kind].format(f'"{file}"' if " " in str(file) else file)
    sentence = f"{file}: expected {expected.words}, got {kind.words}: {command}"
    raise InvalidContent.of_field("file", sentence)
