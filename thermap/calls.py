"""Every route described once: what is sent, and how its answer is read.

Both clients send these; neither knows a path or a body.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import islice
from typing import TYPE_CHECKING, Any, Final, TypeAlias, Union, cast
from urllib.parse import quote

import httpx
from pydantic import BaseModel

from thermap.answers import (
    AccessKey,
    AccuracyAnswer,
    AnswerHead,
    ChangedModelAnswer,
    CompareAnswer,
    CompensationAnswer,
    ConnectionsNow,
    ControllersAnswer,
    CorrelationAnswer,
    CurrentCompensationAnswer,
    ErrorMapAnswer,
    Events,
    ExportAnswer,
    GridAnswer,
    HealthAnswer,
    History,
    LevelsAnswer,
    LinesAnswer,
    MachineAnswer,
    MachineStatus,
    MapPreview,
    MeasurementAnswer,
    ModelAnswer,
    ModelCoverageAnswer,
    NeededAnswer,
    NewAccessKey,
    ParseAnswer,
    PredictionAnswer,
    PresetAnswer,
    PreviewAnswer,
    ReadingSchema,
    ReadyAnswer,
    Receiver,
    Receivers,
    RotaryErrorAnswer,
    SimulatedStepDiagonal,
    StoredReadings,
    StoredVerificationAnswer,
    VerificationPreview,
    VisitPreview,
    WaitingAssignmentAnswer,
    WithdrawnReadingAnswer,
    WithdrawnReadings,
)
from thermap.call import Answer, Call, Content, nothing, reader_of
from thermap.errors import error_of, unreadable
from thermap.table import needs

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    FloatArray: TypeAlias = NDArray[np.float64]

HTML: Final = "text/html"
NPY: Final = "application/x-npy"
ANSWER_HEADER: Final = "Thermap-Answer"
"""What an answer in numpy's form says beside its numbers, as JSON."""

ImportedFile: TypeAlias = (
    ErrorMapAnswer
    | StoredVerificationAnswer
    | MapPreview
    | VerificationPreview
    | VisitPreview
    | MeasurementAnswer
)
"""What a file is answered with: what was stored, a preview of it, or what readings yield."""

_FILE_ANSWER: Any = Union[ImportedFile, *MeasurementAnswer.__subclasses__()]

READINGS_A_CALL: Final = 10_000
"""As many as the service takes in one request."""

PREVIEW: Final = {"preview": "true"}


@dataclass(frozen=True, slots=True)
class Storing:
    """What is to become of a measurement: nothing, a preview of storing it, or a map.

    Of a drift test its course may be kept as a verification too.
    """

    store: bool = False
    accept_losses: bool = False
    preview: bool = False
    verification: bool = False

    @property
    def query(self) -> dict[str, str]:
        """Write what routes that store anything take of it."""
        return accepting(self.accept_losses) | (PREVIEW if self.preview else {})


@dataclass(frozen=True, slots=True)
class TaggedTable:
    """The current compensation table, and the ETag to ask with for a change of it."""

    table: CurrentCompensationAnswer
    etag: str


@dataclass(frozen=True, slots=True, eq=False)
class VolumetricErrors:
    """Errors [µm] and orientation errors [µrad] at points: shape (n, 3) or (s, n, 3).

    `head` says what the service says beside them: model version, warnings, and which
    components count as zero.
    """

    errors_um: FloatArray
    orientation_urad: FloatArray
    head: AnswerHead


# -- health --------------------------------------------------------------------------------


def health() -> Call[HealthAnswer]:
    """GET /healthz."""
    return Call("GET", "/healthz", reader_of(HealthAnswer))


def ready() -> Call[ReadyAnswer]:
    """GET /readyz: 503 is an answer too, unless a proxy gives it."""
    return Call("GET", "/readyz", _read_ready, answered_by=frozenset({503}))


def metrics() -> Call[str]:
    """GET /metrics."""
    return Call("GET", "/metrics", lambda response: response.text)


# -- keys ----------------------------------------------------------------------------------


def keys() -> Call[list[AccessKey]]:
    """GET /v1/keys."""
    return Call("GET", "/v1/keys", reader_of(list[AccessKey]))


def create_key(name: str, role: str, machines: Sequence[str] | None) -> Call[NewAccessKey]:
    """POST /v1/keys."""
    bound_to = None if machines is None else list(machines)
    body = {"name": name, "role": role, "machines": bound_to}
    return Call("POST", "/v1/keys", reader_of(NewAccessKey), body)


def revoke_key(name: str, last_admin: bool) -> Call[None]:
    """DELETE /v1/keys/{name}."""
    query = {"last_admin": "true"} if last_admin else {}
    return Call("DELETE", f"/v1/keys/{quote(name, safe='')}", nothing, query=query)


# -- machines ------------------------------------------------------------------------------


def create_machine(settings: Content) -> Call[MachineAnswer]:
    """POST /v1/machines."""
    return Call("POST", "/v1/machines", reader_of(MachineAnswer), settings)


def machines() -> Call[list[MachineAnswer]]:
    """GET /v1/machines."""
    return Call("GET", "/v1/machines", reader_of(list[MachineAnswer]))


def machine(machine_id: str) -> Call[MachineAnswer]:
    """GET /v1/machines/{machine}."""
    return Call("GET", of_machine(machine_id), reader_of(MachineAnswer))


def statuses() -> Call[list[MachineStatus]]:
    """GET /v1/status."""
    return Call("GET", "/v1/status", reader_of(list[MachineStatus]))


def status(machine_id: str) -> Call[MachineStatus]:
    """GET …/status."""
    return Call("GET", of_machine(machine_id, "status"), reader_of(MachineStatus))


def connections() -> Call[ConnectionsNow]:
    """GET /v1/connections."""
    return Call("GET", "/v1/connections", reader_of(ConnectionsNow))


def receivers() -> Call[Receivers]:
    """GET /v1/receivers."""
    return Call("GET", "/v1/receivers", reader_of(Receivers))


def test_receiver(name: str) -> Call[Receiver]:
    """POST /v1/receivers/{name}/test."""
    return Call("POST", f"/v1/receivers/{quote(name, safe='')}/test", reader_of(Receiver))


def events(
    machine_id: str,
    since: datetime | str | None,
    until: datetime | str | None,
    kinds: Sequence[str],
    before: str | None,
    limit: int | None,
) -> Call[Events]:
    """GET …/events."""
    query = _events_query(since, until, kinds, before, limit)
    return Call("GET", of_machine(machine_id, "events"), reader_of(Events), query=query)


def all_events(
    since: datetime | str | None,
    until: datetime | str | None,
    kinds: Sequence[str],
    before: str | None,
    limit: int | None,
) -> Call[Events]:
    """GET /v1/events."""
    query = _events_query(since, until, kinds, before, limit)
    return Call("GET", "/v1/events", reader_of(Events), query=query)


def _events_query(
    since: datetime | str | None,
    until: datetime | str | None,
    kinds: Sequence[str],
    before: str | None,
    limit: int | None,
) -> dict[str, Any]:
    kind = list(kinds) or None
    return {"from": since, "to": until, "kind": kind, "before": before, "limit": limit}


def needed_components(
    machine_id: str, preset: str | None = None, tool_length_mm: float = 0.0
) -> Call[NeededAnswer]:
    """GET …/needed-components."""
    query = {"preset": preset, "tool_length_mm": tool_length_mm}
    path = of_machine(machine_id, "needed-components")
    return Call("GET", path, reader_of(NeededAnswer), query=query)


def nonrigid_presets() -> Call[list[PresetAnswer]]:
    """GET /v1/nonrigid-presets."""
    return Call("GET", "/v1/nonrigid-presets", reader_of(list[PresetAnswer]))


def change_machine(machine_id: str, changes: Content) -> Call[MachineAnswer]:
    """PATCH /v1/machines/{machine}."""
    return Call("PATCH", of_machine(machine_id), reader_of(MachineAnswer), changes)


def delete_machine(machine_id: str) -> Call[None]:
    """DELETE /v1/machines/{machine}."""
    return Call("DELETE", of_machine(machine_id), nothing)


# -- error maps ----------------------------------------------------------------------------


def store_error_map(
    machine_id: str, error_map: Content, accept_losses: bool = False
) -> Call[ErrorMapAnswer]:
    """POST …/error-maps."""
    path = of_machine(machine_id, "error-maps")
    return Call("POST", path, reader_of(ErrorMapAnswer), error_map, query=accepting(accept_losses))


def preview_error_map(machine_id: str, error_map: Content) -> Call[PreviewAnswer]:
    """POST …/error-maps?preview=true."""
    path = of_machine(machine_id, "error-maps")
    return Call("POST", path, reader_of(PreviewAnswer), error_map, query=PREVIEW)


def error_maps(machine_id: str) -> Call[list[ErrorMapAnswer]]:
    """GET …/error-maps."""
    return Call("GET", of_machine(machine_id, "error-maps"), reader_of(list[ErrorMapAnswer]))


def error_map(machine_id: str, map_id: int) -> Call[ErrorMapAnswer]:
    """GET …/error-maps/{id}."""
    return Call("GET", of_machine(machine_id, "error-maps", map_id), reader_of(ErrorMapAnswer))


def error_map_file(machine_id: str, map_id: int) -> Call[str]:
    """GET …/error-maps/{id}/file, as CSV."""
    return Call("GET", of_machine(machine_id, "error-maps", map_id, "file"), _read_text)


def delete_error_map(machine_id: str, map_id: int) -> Call[None]:
    """DELETE …/error-maps/{id}."""
    return Call("DELETE", of_machine(machine_id, "error-maps", map_id), nothing)


def preview_map_deletion(machine_id: str, map_id: int) -> Call[PreviewAnswer]:
    """DELETE …/error-maps/{id}?preview=true."""
    path = of_machine(machine_id, "error-maps", map_id)
    return Call("DELETE", path, reader_of(PreviewAnswer), query=PREVIEW)


# -- sensor assignment and models ----------------------------------------------------------


def sensor_assignment(machine_id: str) -> Call[dict[str, str]]:
    """GET …/sensor-assignment."""
    return Call("GET", of_machine(machine_id, "sensor-assignment"), reader_of(dict[str, str]))


def assign_sensors(
    machine_id: str,
    assignment: Mapping[str, str],
    accept_losses: bool = False,
) -> Call[dict[str, str] | WaitingAssignmentAnswer]:
    """PUT …/sensor-assignment; 202 says that the version waits."""
    path = of_machine(machine_id, "sensor-assignment")
    return Call("PUT", path, _read_assigned, assignment, query=accepting(accept_losses))


def preview_assignment(machine_id: str, assignment: Mapping[str, str]) -> Call[PreviewAnswer]:
    """PUT …/sensor-assignment?preview=true."""
    path = of_machine(machine_id, "sensor-assignment")
    return Call("PUT", path, reader_of(PreviewAnswer), assignment, query=PREVIEW)


def correlate_sensors(machine_id: str) -> Call[CorrelationAnswer]:
    """POST …/sensor-assignment/correlate."""
    path = of_machine(machine_id, "sensor-assignment", "correlate")
    return Call("POST", path, reader_of(CorrelationAnswer))


def models(machine_id: str) -> Call[list[ModelAnswer]]:
    """GET …/models."""
    return Call("GET", of_machine(machine_id, "models"), reader_of(list[ModelAnswer]))


def model(machine_id: str, version: int) -> Call[ModelAnswer]:
    """GET …/models/{version}."""
    return Call("GET", of_machine(machine_id, "models", version), reader_of(ModelAnswer))


def model_coverage(machine_id: str, version: int) -> Call[ModelCoverageAnswer]:
    """GET …/models/{version}/coverage."""
    path = of_machine(machine_id, "models", version, "coverage")
    return Call("GET", path, reader_of(ModelCoverageAnswer))


def activate_model(machine_id: str, version: int) -> Call[ChangedModelAnswer]:
    """POST …/models/{version}/activate."""
    path = of_machine(machine_id, "models", version, "activate")
    return Call("POST", path, reader_of(ChangedModelAnswer))


def preview_activation(machine_id: str, version: int) -> Call[PreviewAnswer]:
    """POST …/models/{version}/activate?preview=true."""
    path = of_machine(machine_id, "models", version, "activate")
    return Call("POST", path, reader_of(PreviewAnswer), query=PREVIEW)


# -- live ----------------------------------------------------------------------------------


def store_readings(
    machine_id: str, readings: Content | Iterable[Content]
) -> Iterator[Call[StoredReadings]]:
    """POST …/readings, as often as their number needs."""
    path = of_machine(machine_id, "readings")
    remaining = iter([readings] if isinstance(readings, BaseModel | Mapping) else readings)
    while part := list(islice(remaining, READINGS_A_CALL)):
        yield Call("POST", path, reader_of(StoredReadings), part)


def add_up(parts: Iterable[StoredReadings]) -> StoredReadings:
    """Add what became of each part of a long list of readings.

    >>> add_up([StoredReadings(stored=2, duplicates=1), StoredReadings(stored=1, duplicates=0)])
    StoredReadings(stored=3, duplicates=1, ahead=0, warnings=[])
    """
    stored = list(parts)
    return StoredReadings(
        stored=sum(part.stored for part in stored),
        duplicates=sum(part.duplicates for part in stored),
        ahead=sum(part.ahead for part in stored),
        warnings=[warning for part in stored for warning in part.warnings],
    )


def readings(
    machine_id: str,
    since: datetime | str | None,
    until: datetime | str | None,
    every_s: float | None,
    limit: int | None,
) -> Call[list[ReadingSchema]]:
    """GET …/readings."""
    query = {"from": since, "to": until, "every_s": every_s, "limit": limit}
    return Call(
        "GET", of_machine(machine_id, "readings"), reader_of(list[ReadingSchema]), query=query
    )


def history(
    machine_id: str,
    since: datetime | str | None,
    until: datetime | str | None,
    sensors: Iterable[str],
    component: str | None,
    position_mm: float | None,
    points: int | None,
    *,
    residuals: bool,
) -> Call[History]:
    """GET …/history."""
    query = {
        "from": since,
        "to": until,
        "sensor": list(sensors) or None,
        "component": component,
        "position_mm": position_mm,
        "points": points,
        "residuals": "true" if residuals else None,
    }
    return Call("GET", of_machine(machine_id, "history"), reader_of(History), query=query)


def withdrawn_readings(
    machine_id: str, since: datetime | str | None, until: datetime | str | None, limit: int | None
) -> Call[list[WithdrawnReadingAnswer]]:
    """GET …/readings/withdrawn."""
    path = of_machine(machine_id, "readings", "withdrawn")
    query = {"from": since, "to": until, "limit": limit}
    return Call("GET", path, reader_of(list[WithdrawnReadingAnswer]), query=query)


def withdraw_reading(machine_id: str, time: datetime | str) -> Call[WithdrawnReadings]:
    """DELETE …/readings of one time."""
    path = of_machine(machine_id, "readings")
    return Call("DELETE", path, reader_of(WithdrawnReadings), query={"time": time})


def withdraw_readings(
    machine_id: str, since: datetime | str, until: datetime | str
) -> Call[WithdrawnReadings]:
    """DELETE …/readings between two times."""
    query = {"from": since, "to": until}
    return Call(
        "DELETE", of_machine(machine_id, "readings"), reader_of(WithdrawnReadings), query=query
    )


def compensation(
    machine_id: str, temperatures_c: Mapping[str, float], state: Mapping[str, float] | None
) -> Call[CompensationAnswer]:
    """POST …/compensation."""
    body = {"temperatures_c": temperatures_c, "state": state or {}}
    return Call("POST", of_machine(machine_id, "compensation"), reader_of(CompensationAnswer), body)


def controllers() -> Call[ControllersAnswer]:
    """GET /v1/controllers."""
    return Call("GET", "/v1/controllers", reader_of(ControllersAnswer))


def export_compensation(
    machine_id: str, controller: str, question: Content | None
) -> Call[ExportAnswer]:
    """POST …/compensation/export."""
    return Call(
        "POST",
        of_machine(machine_id, "compensation/export"),
        reader_of(ExportAnswer),
        question or {},
        query={"controller": controller},
    )


def compare_compensation(
    machine_id: str, controller: str, question: Content
) -> Call[CompareAnswer]:
    """POST …/compensation/compare."""
    return Call(
        "POST",
        of_machine(machine_id, "compensation/compare"),
        reader_of(CompareAnswer),
        question,
        query={"controller": controller},
    )


def parse_controller_files(controller: str, question: Content) -> Call[ParseAnswer]:
    """POST /v1/controllers/{controller}/parse."""
    path = f"/v1/controllers/{quote(controller, safe='')}/parse"
    return Call("POST", path, reader_of(ParseAnswer), question)


def current_table(machine_id: str, etag: str | None) -> Call[TaggedTable | None]:
    """GET …/compensation; 304 is the answer None."""
    return Call(
        "GET",
        of_machine(machine_id, "compensation"),
        _read_tagged,
        headers={"If-None-Match": etag} if etag else {},
        answered_by=frozenset({304}),
    )


def predict(
    machine_id: str,
    observations: Iterable[Content],
    model_version: int | None,
    missing_components: str,
) -> Call[PredictionAnswer]:
    """POST …/predictions."""
    body: dict[str, Any] = {"observations": list(observations)}
    body["missing_components"] = missing_components
    if model_version is not None:
        body["model_version"] = model_version
    return Call("POST", of_machine(machine_id, "predictions"), reader_of(PredictionAnswer), body)


# -- geometry ------------------------------------------------------------------------------


def volumetric_error(machine_id: str, question: Content) -> Call[VolumetricErrors]:
    """POST …/volumetric-error, answered in numpy's form; ImportError where there is no numpy."""
    needs("numpy", "volumetric_error")
    path = of_machine(machine_id, "volumetric-error")
    return Call("POST", path, _read_vectors, question, headers={"Accept": NPY})


def grid(machine_id: str, question: Content) -> Call[GridAnswer]:
    """POST …/compensation/grid."""
    path = of_machine(machine_id, "compensation", "grid")
    return Call("POST", path, reader_of(GridAnswer), question)


def volumetric_accuracy(machine_id: str, question: Content) -> Call[AccuracyAnswer]:
    """POST …/volumetric-accuracy."""
    path = of_machine(machine_id, "volumetric-accuracy")
    return Call("POST", path, reader_of(AccuracyAnswer), question)


def accuracy_from_lines(lines: Content) -> Call[LinesAnswer]:
    """POST /v1/volumetric-accuracy/from-lines."""
    return Call("POST", "/v1/volumetric-accuracy/from-lines", reader_of(LinesAnswer), lines)


def compensation_levels(machine_id: str, question: Content) -> Call[LevelsAnswer]:
    """POST …/compensation/levels."""
    path = of_machine(machine_id, "compensation", "levels")
    return Call("POST", path, reader_of(LevelsAnswer), question)


def rotary_axis_error(machine_id: str, question: Content) -> Call[RotaryErrorAnswer]:
    """POST …/rotary-axis-error."""
    path = of_machine(machine_id, "rotary-axis-error")
    return Call("POST", path, reader_of(RotaryErrorAnswer), question)


def current_picture(machine_id: str, missing_components: str) -> Call[str]:
    """GET …/picture, as a page."""
    query = {"missing_components": missing_components}
    return Call(
        "GET", of_machine(machine_id, "picture"), _read_text, query=query, headers={"Accept": HTML}
    )


def picture(machine_id: str, question: Content) -> Call[dict[str, Any]]:
    """POST …/picture, as a figure."""
    return Call("POST", of_machine(machine_id, "picture"), reader_of(dict[str, Any]), question)


# -- measurements --------------------------------------------------------------------------


def file_template(machine_id: str, kind: str) -> Call[str]:
    """GET …/files/template, as CSV."""
    path = of_machine(machine_id, "files", "template")
    return Call("GET", path, _read_text, query={"kind": kind})


def send_file(
    machine_id: str, name: str, content: bytes, beside: Mapping[str, Any], storing: Storing
) -> Call[ImportedFile]:
    """POST …/files; `beside` is what is said of the file beside it."""
    query = {"name": name, **beside, **storing.query}
    query |= {} if storing.store else {"store": "false"}
    query |= {"store_verification": "true"} if storing.verification else {}
    answered = reader_of(cast("type[ImportedFile]", _FILE_ANSWER))
    return Call("POST", of_machine(machine_id, "files"), answered, content, query=query)


def measure(
    machine_id: str, method: str, answer: type[Answer], measurement: Content, storing: Storing
) -> Call[Answer]:
    """POST …/measurements/{method}, which answers with its own shape."""
    path = of_machine(machine_id, "measurements", method)
    query = {"store": "true" if storing.store else "false"} | storing.query
    query |= {"store_verification": "true"} if storing.verification else {}
    return Call("POST", path, reader_of(answer), measurement, query=query)


def simulate_step_diagonal(machine_id: str, plan: Content) -> Call[SimulatedStepDiagonal]:
    """POST …/measurements/step-diagonal/simulate."""
    path = of_machine(machine_id, "measurements", "step-diagonal", "simulate")
    return Call("POST", path, reader_of(SimulatedStepDiagonal), plan)


def accepting(accept_losses: bool) -> dict[str, str]:
    """Write the query that lets a version be active although it loses something."""
    return {"accept_losses": "true"} if accept_losses else {}


def of_machine(machine_id: str, *further: str | int) -> str:
    """Name a path below a machine, whatever characters its id has.

    >>> of_machine("mill 3/b", "models", 2)
    '/v1/machines/mill%203%2Fb/models/2'
    """
    if not machine_id:
        raise ValueError("expected a machine's id, got an empty one")
    return "/".join(["/v1/machines", quote(machine_id, safe=""), *map(str, further)])


def _read_assigned(response: httpx.Response) -> dict[str, str] | WaitingAssignmentAnswer:
    if response.status_code == httpx.codes.ACCEPTED:
        return reader_of(WaitingAssignmentAnswer)(response)
    return reader_of(dict[str, str])(response)


def _read_ready(response: httpx.Response) -> ReadyAnswer:
    if response.headers.get("content-type", "") != "application/json":
        raise error_of(response)
    return reader_of(ReadyAnswer)(response)


def _read_text(response: httpx.Response) -> str:
    return response.text


def _read_vectors(response: httpx.Response) -> VolumetricErrors:
    """Read one array of shape (n, 6) or (s, n, 6), and the head beside it."""
    import numpy as np

    try:
        numbers = np.load(io.BytesIO(response.content), allow_pickle=False)
        head = AnswerHead.model_validate_json(response.headers[ANSWER_HEADER], extra="ignore")
    except (ValueError, KeyError, EOFError) as error:
        raise unreadable(response, f"no array of errors: {error}") from error
    return VolumetricErrors(numbers[..., :3], numbers[..., 3:], head)


def _read_tagged(response: httpx.Response) -> TaggedTable | None:
    if response.status_code == httpx.codes.NOT_MODIFIED:
        return None
    table = reader_of(CurrentCompensationAnswer)(response)
    return TaggedTable(table, response.headers.get("etag", ""))
