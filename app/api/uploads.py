"""Files that come as a request's body, as they are.

What reads one is a dependency, which reads it `in_a_thread` and stands in the `read_first` of a
router with `FileRoute`s: however long that takes, nobody holds a turn at the database meanwhile.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Final

from fastapi import Depends, Query, Request

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
from app.api.methods.method import Evaluated, Method
from app.api.methods.registry import METHODS, method_named
from app.api.uploaded_map import FileMap, UploadedMeasurement, read_uploaded_map
from app.api.uploaded_verification import UploadedVerification, read_uploaded_verification
from app.decimal_text import read_number
from app.errors import FieldError, InvalidContent, list_names
from app.files.csv_comments import Header
from app.services.measurements import MeasurementRequest, Storing, map_of_result
from app.stated import UtcTime
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
    """The map of a file, and what was noticed."""

    error_map: ErrorMap
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
        return FoundMap(error_map, [*self.remarks, *result.notes])


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

    def read_and_check() -> FileMap | tuple[UploadedMeasurement, MeasurementRequest]:
        read = read_uploaded_map(
            content, name, machine, beside.stated, beside.method, complete=complete
        )
        if isinstance(read, FileMap):
            return read
        return read, read.method.checked(read.body)

    read = await in_a_thread(read_and_check)
    live = await machine_in_memory(request, context, machine)
    if isinstance(read, FileMap):
        return FoundMap(await in_a_thread(read.error_map.to_error_map), read.remarks)
    described = live.current.model.machine
    (measurement, body), method = read, read[0].method
    evaluated = await in_a_thread(lambda: method.evaluate(context, described, body))
    return FoundReadings(method, described, body, evaluated, measurement.remarks)


def refuse_what_readings_have(name: str, beside: Beside, storing: Storing) -> None:
    """Refuse for a map what says something of readings alone."""
    stated: dict[str, object] = {"axis": beside.stated.axis, "store_verification": storing.course}
    stated["store"] = not (storing.store or storing.preview)
    message = f"expected with readings alone, but {name} holds a map"
    if wrong := [FieldError(field, message) for field, is_stated in stated.items() if is_stated]:
        raise InvalidContent(f"{list_names(e.field for e in wrong)}: {message}", wrong)


async def uploaded_verification(
    machine: str, content: bytes, name: str, *, is_planned: bool = False
) -> UploadedVerification:
    """Read the verification that came."""
    return await in_a_thread(
        lambda: read_uploaded_verification(content, name, machine, is_planned=is_planned)
    )
