"""What makes an error map, from a file that came over HTTP."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from app.api.methods.method import Method
from app.api.methods.registry import METHODS
from app.api.schemas.error_maps import (
    ComponentAnswer,
    ComponentSchema,
    ErrorMapAnswer,
    ErrorMapSchema,
)
from app.errors import FieldError, InvalidContent
from app.field_errors import field_error
from app.files.csv_comments import Header, with_stated
from app.files.csv_error_map import parse_csv_error_map
from app.files.csv_measurements import completed
from app.files.delimited_text import (
    Problems,
    UnreadableFile,
    only_sheet,
    read_sheets,
    sheets_of,
)
from app.files.file_kind import FileKind, is_json, json_of, refuse_other_kind
from app.files.instrument_files import InstrumentFormat, format_of_text
from app.files.read_body import ReadBody


@dataclass(frozen=True, slots=True)
class FileMap:
    """A map as it is to be sent, the machine that the file names, and what was noticed."""

    error_map: ErrorMapSchema
    machine: str | None
    remarks: Sequence[str]


def read_error_map(file: Path, header: Header) -> FileMap:
    """Read an error map's table and check all of it, as `parse_error_map` does."""
    return parse_error_map(read_sheets(file), file, header)


def parse_error_map(sheets: Mapping[str, str], file: Path, header: Header) -> FileMap:
    """Make the map of a file's sheets as the service would.

    Raises
    ------
    UnreadableFile
        With line and column of what is wrong, and what the service would refuse.
    """
    read = parse_csv_error_map(sheets, file, header)
    problems = Problems(file)
    try:
        error_map = _checked(read.body, problems)
    except InvalidContent as error:
        problems.add(error.detail)
    problems.raise_if_any()
    return FileMap(error_map, read.machine, read.remarks)


def _checked(body: Any, problems: Problems) -> ErrorMapSchema:
    """Make of a body what the service would, so that what it would refuse is known here.

    Raises
    ------
    UnreadableFile, InvalidContent
        If its fields, or all of it together, cannot be right.
    """
    try:
        error_map = ErrorMapSchema.model_validate(body)
    except ValidationError as error:
        for problem in map(field_error, error.errors()):
            problems.add(f"{problem.field}: {problem.message}")
        problems.raise_if_any()
        raise
    error_map.to_error_map()
    return error_map


@dataclass(frozen=True, slots=True)
class UploadedMeasurement:
    """An instrument's readings: the method, the body in which it is asked, what was noticed."""

    method: Method[Any, Any]
    body: Mapping[str, Any]
    remarks: Sequence[str]


def read_uploaded_map(
    content: bytes,
    name: str,
    machine: str,
    header: Header,
    method: Method[Any, Any] | None = None,
    *,
    complete: bool = True,
) -> FileMap | UploadedMeasurement:
    """Read an error map, or a measurement that makes one, from what is in a file.

    CSV, Excel workbooks and JSON hold an error map, or with a stated method its readings; files as
    instruments write them say themselves which method it was.

    Parameters
    ----------
    name
        The file's name, under which complaints stand.
    header
        What takes precedence over what the file says.
    method
        By which method it was measured, where the file holds readings and no map.
    complete
        Whether readings need label, time and temperatures, as for storing a map.

    Raises
    ------
    InvalidContent
        With an entry, under `file`, for everything that is wrong in the words of the command
        line: line, column, what was expected and what came; under its own name for what the file
        lacks and may be stated; if it is of another method or machine, or a check.
    """
    file = Path(name or "file.csv")
    expects_map = method is None
    is_contract = is_json(content, file)
    try:
        content_read: FileMap | ReadBody
        sheets = {} if is_contract else sheets_of(content, file)
        written = None if is_contract else format_of_text(file, next(iter(sheets.values()), ""))
        if method is not None and is_contract:
            content_read = completed(
                _body_of(content, file, method), method.file, file, header, complete=complete
            )
        elif is_contract:
            content_read = _of_json(content, file, header)
        elif written is not None:
            method = _method_of(file, written, method)
            text = only_sheet(sheets, file)
            read = written.read(text, file, header.axis)
            content_read = completed(read, method.file, file, header, complete=complete)
        elif method is not None:
            text = only_sheet(sheets, file)
            content_read = method.read(text, name=str(file), header=header, complete=complete)
        else:
            content_read = parse_error_map(sheets, file, header)
    except UnreadableFile as error:
        if expects_map:
            refuse_other_kind(FileKind.MAP, content, file)
        errors = [FieldError("file", line) for line in error.wrong]
        errors += [FieldError(lack.field, lack.message) for lack in error.lacks]
        raise InvalidContent(error.detail, errors) from None
    if content_read.machine not in (None, machine):
        raise InvalidContent.of_field(
            "file",
            f"{file}: expected a map of machine {machine!r}, got one that says that it is of "
            f"{content_read.machine!r}",
        )
    if isinstance(content_read, FileMap):
        return content_read
    assert method is not None
    return UploadedMeasurement(method, content_read.body, content_read.remarks)


def _of_json(content: bytes, file: Path, header: Header) -> FileMap:
    """Read the one map in a request's JSON, or in an answer's."""
    problems = Problems(file)
    document = json_of(content, problems)
    entries = document if isinstance(document, list) else [document]
    entry = entries[0] if len(entries) == 1 else None
    if len(entries) != 1:
        problems.add(
            f"expected one error map, got {len(entries)} entries: send one after the other"
        )
    elif not isinstance(entry, dict):
        problems.add(f"expected an error map, got {type(entry).__name__}")
    elif "components" not in entry and "measured_at" not in entry:
        other = "a machine" if "configuration" in entry else f"fields {', '.join(entry)}"
        problems.add(f"expected an error map, got {other}")
    problems.raise_if_any()
    assert isinstance(entry, dict)
    try:
        error_map = _checked(_as_stated(with_stated(entry, header)), problems)
    except InvalidContent as error:
        for message in [f"{e.field}: {e.message}" for e in error.errors] or [error.detail]:
            problems.add(message)
    problems.raise_if_any()
    return FileMap(error_map, None, ())


_ADDED: Final = ErrorMapAnswer.model_fields.keys() - ErrorMapSchema.model_fields.keys()
_ADDED_TO_COMPONENTS: Final = (
    ComponentAnswer.model_fields.keys() - ComponentSchema.model_fields.keys()
)
"""Fields of an answer that nobody states."""


def _as_stated(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Leave away what an answer has beyond what is stated."""
    fields = {name: value for name, value in entry.items() if name not in _ADDED}
    if isinstance(fields.get("components"), list):
        fields["components"] = [
            {name: value for name, value in component.items() if name not in _ADDED_TO_COMPONENTS}
            if isinstance(component, dict)
            else component
            for component in fields["components"]
        ]
    return fields


def _body_of(content: bytes, file: Path, method: Method[Any, Any]) -> ReadBody:
    """Read the body of a method's request."""
    problems = Problems(file)
    body = json_of(content, problems)
    if not isinstance(body, dict):
        problems.add(
            f"expected the fields of a {method.name} measurement, got {type(body).__name__}"
        )
    problems.raise_if_any()
    return ReadBody(body, None, ())


def _method_of(
    file: Path, written: InstrumentFormat, method: Method[Any, Any] | None
) -> Method[Any, Any]:
    if method is not None and method.name != written.method:
        raise InvalidContent.of_field(
            "method",
            f"expected {written.method}, which {file} holds as {written.name}, got {method.name}",
        )
    return METHODS[written.method]
