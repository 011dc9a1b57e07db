"""Files that come as a request's body, as they are: read and checked as what they hold.

What reads one is a dependency, which reads it `in_a_thread` and stands in the `read_first` of a
router with `FileRoute`s: however long that takes, nobody holds a turn at the database meanwhile.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Final

from fastapi import Depends, Query, Request
from pydantic import ValidationError

from app.api.bodies import body_of_at_most, in_a_thread
from app.api.dependencies import (
    AcceptLossesQuery,
    ContextDep,
    CourseQuery,
    MachinePath,
    PreviewQuery,
    machine_in_memory,
)
from app.api.media_types import CSV, XLSX
from app.api.methods.method import Method
from app.api.methods.registry import METHODS, method_named
from app.decimal_text import read_number
from app.effects.observations import Verification
from app.errors import FieldError, InvalidContent, list_names
from app.field_errors import field_error
from app.files.csv_comments import Header, with_stated
from app.files.csv_error_map import parse_csv_error_map
from app.files.csv_measurements import completed
from app.files.csv_verification import parse_csv_verification
from app.files.delimited_text import (
    Problems,
    UnreadableFile,
    only_sheet,
    sheets_of,
)
from app.files.file_kind import FileKind, is_json, json_of, refuse_other_kind
from app.files.instrument_files import InstrumentFormat, format_of_text
from app.files.read_body import ReadBody
from app.measurement.result import Evaluated
from app.services.error_maps import ErrorMapAnswer
from app.services.measurements import MeasurementRequest, Storing, map_of_result
from app.services.observations import PlannedVerification, VerificationRequest
from app.stated import UtcTime
from app.thermal.error_map import ERROR_MAP, ComponentAnswer, ComponentSchema, ErrorMap
from app.thermal.machine import Machine

_LARGEST_MB: Final = 32
_TEXTS: Final = (CSV, "text/plain", "text/tab-separated-values")
_BINARY: Final = (XLSX, "application/vnd.ms-excel", "application/octet-stream")
"""By which programs call such files; Windows calls CSV the second. Readers look at the content."""

FILE_BODY: Final[dict[str, Any]] = body_of_at_most(_LARGEST_MB) | {
    "requestBody": {
        "required": True,
        "content": {
            **{kind: {"schema": {"type": "string"}} for kind in _TEXTS},
            **{kind: {"schema": {"type": "string", "format": "binary"}} for kind in _BINARY},
        },
    }
}


async def _file_content(request: Request) -> bytes:
    return await request.body()


FileContent = Annotated[bytes, Depends(_file_content)]
FileName = Annotated[
    str,
    Query(max_length=1000, description="The file's name, for messages", examples=["run-9.csv"]),
]


@dataclass(frozen=True, slots=True)
class Beside:
    """What is stated of a file beside it."""

    stated: Header
    method: Method[Any, Any] | None

    @property
    def names(self) -> list[str]:
        """Name what is stated, as the query does."""
        beside = self.stated
        stated = {
            "label": beside.label,
            "measured_at": beside.measured_at,
            "temperature": beside.temperatures_c,
            "axis": beside.axis,
            "method": self.method,
        }
        return [name for name, value in stated.items() if value]


def _beside(
    label: Annotated[
        str | None, Query(max_length=200, description="The map's name, where the file has none")
    ] = None,
    measured_at: Annotated[
        UtcTime | None, Query(description="When it was measured, ISO 8601 with its zone")
    ] = None,
    temperature: Annotated[
        list[str] | None,
        Query(
            max_length=1000,
            description="A sensor's temperature at that time, SENSOR=°C, once for each sensor",
            examples=["x-middle=24.1"],
        ),
    ] = None,
    axis: Annotated[
        str | None,
        Query(
            max_length=1,
            description="The axis that was measured, where an instrument's file has none, or free "
            "text that names no single one",
        ),
    ] = None,
    method: Annotated[
        str | None,
        Query(
            max_length=100,
            description=f"By which method it was measured, of {list_names(METHODS)}: where the "
            "file is a table of an instrument's readings, and not of errors",
        ),
    ] = None,
) -> Beside:
    time = None if measured_at is None else measured_at.isoformat()
    header = Header(label, time, _temperatures(temperature or ()), axis)
    return Beside(header, None if method is None else method_named(method))


def _temperatures(stated: Sequence[str]) -> dict[str, float]:
    """Read what is stated of the sensors [°C]; what is wrong is named by its sensor."""
    found: dict[str, float] = {}
    wrong = []
    for one in stated:
        sensor, _, text = one.rpartition("=")
        value = read_number(text)
        if not sensor or value is None:
            expected = "a number in °C" if sensor else "SENSOR=°C, such as x-middle=24.1"
            name = f"temperatures_c.{sensor}" if sensor else "temperature"
            wrong.append(FieldError(name, f"expected {expected}, got {text!r}"))
        elif sensor in found:
            wrong.append(FieldError(f"temperatures_c.{sensor}", "expected once, came again"))
        else:
            found[sensor] = value
    if wrong:
        raise InvalidContent("; ".join(f"{one.field}: {one.message}" for one in wrong), wrong)
    return found


def _storing(
    store: Annotated[
        bool,
        Query(
            description="Whether a map is stored, or the readings of `method` are evaluated alone; "
            "they need no label, time and temperatures then"
        ),
    ] = True,
    preview: PreviewQuery = False,
    accept_losses: AcceptLossesQuery = False,
    store_verification: CourseQuery = False,
) -> Storing:
    return Storing(store, preview, accept_losses, store_verification)


StoringQuery = Annotated[Storing, Depends(_storing)]


@dataclass(frozen=True, slots=True, eq=False)
class FoundMap:
    """The map of a file, the machine that the file names, and what was noticed."""

    error_map: ErrorMap
    machine: str | None
    remarks: Sequence[str]


@dataclass(frozen=True, slots=True, eq=False)
class FoundReadings:
    """An instrument's readings on a machine: the body in which it is asked, and what comes out."""

    method: Method[Any, Any]
    machine: Machine
    body: MeasurementRequest
    evaluated: Evaluated
    remarks: Sequence[str]

    def as_map(self) -> FoundMap:
        """Make the map of them.

        Raises
        ------
        InvalidContent
            If the method makes several, or none.
        """
        if not self.method.makes_one_map:
            raise InvalidContent.of_field(
                "method",
                f"expected a method that makes one map, got {self.method.name}: `thermap import "
                f"--method {self.method.name}` shows what it makes",
            )
        result = self.evaluated.result
        error_map = map_of_result(self.machine, self.method.name, self.body, result)
        return FoundMap(error_map, self.machine.id, [*self.remarks, *result.notes])


@dataclass(frozen=True, slots=True)
class FoundVerification:
    """A verification of a file, and where in it each observation stands.

    Parameters
    ----------
    body
        The request's, as the file has it.
    remarks
        What of the file was not read.
    """

    file: Path
    verification: Verification
    body: Any
    remarks: Sequence[str]
    lines: Sequence[int]

    def refusal(self, error: InvalidContent) -> InvalidContent:
        """Say what is refused of the observations by the lines in which they stand."""
        problems = Problems(self.file)
        _complain(problems, error.errors, self.lines)
        return _of_lines(problems.listed())


BesideQuery = Annotated[Beside, Depends(_beside)]


async def uploaded_map(
    request: Request,
    context: ContextDep,
    machine: MachinePath,
    content: FileContent,
    beside: BesideQuery,
    storing: StoringQuery,
    name: FileName = "file.csv",
) -> FoundMap | FoundReadings:
    """Read the map or the measurement that came, check what it says, and evaluate readings.

    A million readings take seconds: nobody else waits for the database meanwhile.
    """
    complete = storing.store or storing.preview or storing.course

    def read_and_check() -> FoundMap | tuple[Method[Any, Any], MeasurementRequest, Sequence[str]]:
        read = read_uploaded_map(
            content, name, machine, beside.stated, beside.method, complete=complete
        )
        if isinstance(read, FoundMap):
            return read
        method, found = read
        return method, method.checked(found.body), found.remarks

    read = await in_a_thread(read_and_check)
    live = await machine_in_memory(request, context, machine)
    if isinstance(read, FoundMap):
        return read
    described = live.current.model.machine
    method, body, remarks = read
    evaluated = await in_a_thread(lambda: method.evaluate(context, described, body))
    return FoundReadings(method, described, body, evaluated, remarks)


def refuse_what_readings_have(name: str, beside: Beside, storing: Storing) -> None:
    """Refuse for a map what says something of readings alone."""
    stated: dict[str, object] = {"axis": beside.stated.axis, "store_verification": storing.course}
    stated["store"] = not (storing.store or storing.preview)
    message = f"expected with readings alone, but {name} holds a map"
    if wrong := [FieldError(field, message) for field, is_stated in stated.items() if is_stated]:
        raise InvalidContent(f"{list_names(e.field for e in wrong)}: {message}", wrong)


async def uploaded_verification(
    machine: str, content: bytes, name: str, *, is_planned: bool = False
) -> FoundVerification:
    """Read the verification that came."""
    return await in_a_thread(
        lambda: read_uploaded_verification(content, name, machine, is_planned=is_planned)
    )


def parse_error_map(sheets: Mapping[str, str], file: Path, header: Header) -> FoundMap:
    """Make the map of a file's sheets as if it had come as JSON.

    Raises
    ------
    UnreadableFile
        With line and column of what is wrong.
    """
    read = parse_csv_error_map(sheets, file, header)
    return FoundMap(_checked_map(read.body, file), read.machine, read.remarks)


def _checked_map(body: Any, file: Path) -> ErrorMap:
    try:
        return ERROR_MAP.validate_python(body)
    except ValidationError as error:
        problems = Problems(file)
        _complain(problems, map(field_error, error.errors()))
        problems.raise_if_any()
        raise


def read_uploaded_map(
    content: bytes,
    name: str,
    machine: str,
    header: Header,
    method: Method[Any, Any] | None = None,
    *,
    complete: bool = True,
) -> FoundMap | tuple[Method[Any, Any], ReadBody]:
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
        content_read: FoundMap | ReadBody
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
    if isinstance(content_read, FoundMap):
        return content_read
    assert method is not None
    return method, content_read


def _of_json(content: bytes, file: Path, header: Header) -> FoundMap:
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
    return FoundMap(_checked_map(_as_stated(with_stated(entry, header)), file), None, ())


_ADDED: Final = {f.name for f in fields(ErrorMapAnswer)} - {f.name for f in fields(ErrorMap)}
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


_PLACE: Final = re.compile(r"observations\.(\d+)\b\.?(.*)")
_VALUE: Final = "measured_"
"""Fields that begin so hold what was measured."""


def read_uploaded_verification(
    content: bytes, name: str, machine: str, *, is_planned: bool = False
) -> FoundVerification:
    """Read a verification from what is in a file: CSV, an Excel workbook, or a request's JSON.

    Parameters
    ----------
    name
        The file's name, under which complaints stand; without a label it is called so.
    is_planned
        Whether it is yet to be measured: measured values are not looked at.

    Raises
    ------
    InvalidContent
        With an entry, under `file`, for everything that is wrong in the words of the command
        line: line, column, what was expected and what came; if an instrument wrote it; if it
        is another machine's.
    """
    file = Path(name or "file.csv")
    try:
        if is_json(content, file):
            problems = Problems(file)
            body = json_of(content, problems)
            if is_planned:
                body = _without_values(body)
            verification = _checked_check(body, file, is_planned=is_planned)
            return FoundVerification(file, verification, body, (), ())
        read = parse_csv_verification(sheets_of(content, file), file, is_planned=is_planned)
        if read.machine not in (None, machine):
            raise UnreadableFile(
                f"{file} says that it belongs to {read.machine!r}, got {machine!r}"
            )
        body = _without_values(read.body) if is_planned else read.body
        verification = _checked_check(body, file, read.lines, is_planned=is_planned)
    except UnreadableFile as error:
        refuse_other_kind(FileKind.CHECK, content, file)
        raise _of_lines(error.wrong) from None
    return FoundVerification(file, verification, body, read.remarks, read.lines)


def _of_lines(lines: Sequence[str]) -> InvalidContent:
    return InvalidContent("\n".join(lines), [FieldError("file", line) for line in lines])


def _without_values(body: Any) -> Any:
    """Leave out of a body what was measured, and by whom; one of another shape is refused later."""
    if not isinstance(body, dict) or not isinstance(body.get("observations"), list):
        return body
    planned = [
        {k: v for k, v in o.items() if not k.startswith(_VALUE)} if isinstance(o, dict) else o
        for o in body["observations"]
    ]
    stated = {k: v for k, v in body.items() if k not in ("instrument", "operator")}
    return stated | {"observations": planned}


def _checked_check(
    body: Any, file: Path, lines: Sequence[int] = (), *, is_planned: bool
) -> Verification:
    """Make a verification of a body, as if that had come as JSON.

    Parameters
    ----------
    lines
        Line of each observation, where the file has lines.
    is_planned
        Whether it is yet to be measured, and has no values.

    Raises
    ------
    UnreadableFile
        With everything that is wrong.
    """
    try:
        if is_planned:
            return PlannedVerification.model_validate(body).to_verification()
        return VerificationRequest.model_validate(body).to_verification()
    except ValidationError as error:
        wrong: Iterable[FieldError] = map(field_error, error.errors())
    except InvalidContent as error:
        wrong = error.errors
    problems = Problems(file)
    _complain(problems, wrong, lines)
    raise UnreadableFile("\n".join(problems.listed()))


def _complain(problems: Problems, errors: Iterable[FieldError], lines: Sequence[int] = ()) -> None:
    """Note messages under the line of their observation where there are lines, else the field."""
    for error in errors:
        place = _PLACE.fullmatch(error.field)
        if place and lines:
            problems.add(error.message, lines[int(place[1])], place[2])
        else:
            problems.add(f"{error.field}: {error.message}")
