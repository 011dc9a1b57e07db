"""Files that come as a request's body, as they are.

What reads one is a dependency, which reads it `in_a_thread` and stands in the `read_first` of a
router with `FileRoute`s: however long that takes, nobody holds a turn at the database meanwhile.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Final

from fastapi import Depends, Query, Request

from app.api.bodies import body_of_at_most, in_a_thread
from app.api.dependencies import ContextDep, MachinePath, machine_in_memory
from app.api.evaluations import EVALUATIONS
from app.api.media_types import CSV, XLSX
from app.api.schemas.base import UtcTime
from app.api.schemas.measurements.base import MeasurementRequest
from app.api.uploaded_map import FileMap, read_uploaded_map
from app.api.uploaded_verification import UploadedVerification, read_uploaded_verification
from app.decimal_text import read_number
from app.errors import FieldError, InvalidContent, list_names
from app.files.csv_comments import Header
from app.services.measurements import map_of_result
from app.thermal.error_map import ErrorMap
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
    Query(max_length=200, description="The file's name, for messages", examples=["run-9.csv"]),
]


@dataclass(frozen=True, slots=True)
class Beside:
    """What is stated of a file beside it."""

    stated: Header
    method: str | None

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
            description=f"By which method it was measured, of {list_names(EVALUATIONS)}: where the "
            "file is a table of an instrument's readings, and not of errors",
        ),
    ] = None,
) -> Beside:
    if method is not None and method not in EVALUATIONS:
        raise InvalidContent.of_field(
            "method", f"expected one of {list_names(EVALUATIONS)}, got {method!r}"
        )
    time = None if measured_at is None else measured_at.isoformat()
    return Beside(Header(label, time, _temperatures(temperature or ()), axis), method)


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


@dataclass(frozen=True, slots=True)
class _Readings:
    """An instrument's readings: the method, the body in which it is asked, what was noticed."""

    method: str
    body: MeasurementRequest
    remarks: Sequence[str]


@dataclass(frozen=True, slots=True, eq=False)
class FoundMap:
    """The map of a file, what was noticed, and a measurement's own figures."""

    error_map: ErrorMap
    remarks: Sequence[str]
    method: str | None = None
    figures: Mapping[str, float] = field(default_factory=dict)


BesideQuery = Annotated[Beside, Depends(_beside)]


async def uploaded_map(
    request: Request,
    context: ContextDep,
    machine: MachinePath,
    content: FileContent,
    beside: BesideQuery,
    name: FileName = "file.csv",
) -> FoundMap:
    """Read the map or the measurement that came, check what it says, and evaluate readings.

    A million readings take seconds: nobody else waits for the database meanwhile.
    """

    def read_and_check() -> FileMap | _Readings:
        read = read_uploaded_map(content, name, machine, beside.stated, beside.method)
        if isinstance(read, FileMap):
            return read
        body = EVALUATIONS[read.method].checked(read.body)
        return _Readings(read.method, body, read.remarks)

    read = await in_a_thread(read_and_check)
    live = await machine_in_memory(request, context, machine)
    described = live.current.model.machine
    return await in_a_thread(lambda: _map_of(described, read))


def _map_of(described: Machine, read: FileMap | _Readings) -> FoundMap:
    """Give a file's map, or evaluate the readings in it."""
    if isinstance(read, FileMap):
        return FoundMap(read.error_map.to_error_map(), read.remarks)
    result = EVALUATIONS[read.method].evaluate(described, read.body)
    error_map = map_of_result(described, read.method, read.body.header(), result)
    return FoundMap(error_map, [*read.remarks, *result.notes], read.method, result.figures)


async def uploaded_verification(machine: str, content: bytes, name: str) -> UploadedVerification:
    """Read the verification that came."""
    return await in_a_thread(lambda: read_uploaded_verification(content, name, machine))
