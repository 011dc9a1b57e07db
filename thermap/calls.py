"""Every route described once: what is sent, and how its answer is read.

Each is a method of both clients, with these parameters and these words.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias, Union, cast
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
from thermap.call import Call, Content, nothing, reader_of
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

# Of a measurement each method has an answer of its own: the one that fits best is read.
_MEASURED: type[MeasurementAnswer] = cast(
    "Any", Union[MeasurementAnswer, *MeasurementAnswer.__subclasses__()]
)
_SENT: type[ImportedFile] = cast("Any", Union[ImportedFile, *MeasurementAnswer.__subclasses__()])

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
        course = {"store_verification": "true"} if self.verification else {}
        return accepting(self.accept_losses) | (PREVIEW if self.preview else {}) | course


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
    """Ask whether the process lives, and its version."""
    return Call("GET", "/healthz", reader_of(HealthAnswer))


def ready() -> Call[ReadyAnswer]:
    """Ask whether the database is there and every model in memory; not being so is no error."""
    return Call("GET", "/readyz", _read_ready, answered_by=frozenset({503}))


def metrics() -> Call[str]:
    """Read the metrics in Prometheus' text format."""
    return Call("GET", "/metrics", lambda response: response.text)


# -- keys ----------------------------------------------------------------------------------


def keys() -> Call[list[AccessKey]]:
    """List the service's keys by name, with their last use; for admins."""
    return Call("GET", "/v1/keys", reader_of(list[AccessKey]))


def create_key(name: str, role: str, machines: Sequence[str] | None = None) -> Call[NewAccessKey]:
    """Make a key, for these machines or for all; its `secret` is shown this once."""
    bound_to = None if machines is None else list(machines)
    body = {"name": name, "role": role, "machines": bound_to}
    return Call("POST", "/v1/keys", reader_of(NewAccessKey), body)


def revoke_key(name: str, *, last_admin: bool = False) -> Call[None]:
    """Let a key be none any more; ConflictError for an admin's last, unless `last_admin`."""
    query = {"last_admin": "true"} if last_admin else {}
    return Call("DELETE", f"/v1/keys/{quote(name, safe='')}", nothing, query=query)


# -- machines ------------------------------------------------------------------------------


def create_machine(settings: Content) -> Call[MachineAnswer]:
    """Create a machine from a `MachineSettings`; ConflictError if its id is taken."""
    return Call("POST", "/v1/machines", reader_of(MachineAnswer), settings)


def machines() -> Call[list[MachineAnswer]]:
    """List all machines by id."""
    return Call("GET", "/v1/machines", reader_of(list[MachineAnswer]))


def machine(machine: str) -> Call[MachineAnswer]:
    """Show one machine."""
    return Call("GET", of_machine(machine), reader_of(MachineAnswer))


def statuses() -> Call[list[MachineStatus]]:
    """Say of every machine whether it can be trusted now, by id."""
    return Call("GET", "/v1/status", reader_of(list[MachineStatus]))


def status(machine: str) -> Call[MachineStatus]:
    """Say whether a machine can be trusted now, and why not."""
    return Call("GET", of_machine(machine, "status"), reader_of(MachineStatus))


def connections() -> Call[ConnectionsNow]:
    """Say how what the service reads beside HTTP fares."""
    return Call("GET", "/v1/connections", reader_of(ConnectionsNow))


def receivers() -> Call[Receivers]:
    """List who is told of alarms, and how that went."""
    return Call("GET", "/v1/receivers", reader_of(Receivers))


def test_receiver(name: str) -> Call[Receiver]:
    """Ask for a test message; whether it arrived, `receivers` says some seconds later."""
    return Call("POST", f"/v1/receivers/{quote(name, safe='')}/test", reader_of(Receiver))


def events(
    machine: str | None = None,
    *,
    since: datetime | str | None = None,
    until: datetime | str | None = None,
    kinds: Sequence[str] = (),
    before: str | None = None,
    limit: int | None = None,
) -> Call[Events]:
    """List what happened to a machine, or to all machines and to keys, the newest first.

    Parameters
    ----------
    kinds
        `model`, `alarm`, `sensor` …; none for all.
    before
        `next` of the answer before, for those that come after it in the list.
    """
    path = "/v1/events" if machine is None else of_machine(machine, "events")
    kind = list(kinds) or None
    query = {"from": since, "to": until, "kind": kind, "before": before, "limit": limit}
    return Call("GET", path, reader_of(Events), query=query)


def needed_components(
    machine: str, preset: str | None = None, tool_length_mm: float = 0.0
) -> Call[NeededAnswer]:
    """List the errors that have to be measured, of a rigid machine or of a preset."""
    query = {"preset": preset, "tool_length_mm": tool_length_mm}
    path = of_machine(machine, "needed-components")
    return Call("GET", path, reader_of(NeededAnswer), query=query)


def nonrigid_presets() -> Call[list[PresetAnswer]]:
    """List the kinds of machines that are not rigid, and their slopes."""
    return Call("GET", "/v1/nonrigid-presets", reader_of(list[PresetAnswer]))


def change_machine(machine: str, changes: Content) -> Call[MachineAnswer]:
    """Change the settings that a `MachinePatch` states."""
    return Call("PATCH", of_machine(machine), reader_of(MachineAnswer), changes)


def delete_machine(machine: str) -> Call[None]:
    """Delete a machine with all its maps, models and readings."""
    return Call("DELETE", of_machine(machine), nothing)


# -- error maps ----------------------------------------------------------------------------


def store_error_map(
    machine: str, error_map: Content, *, accept_losses: bool = False
) -> Call[ErrorMapAnswer]:
    """Store an `ErrorMapSchema`; the same content again gives the map that is there.

    A model version whose tables would lose something waits, unless `accept_losses`: the
    answer's `activated` is False then, and `loses` and `next_step` say the rest.
    """
    path = of_machine(machine, "error-maps")
    return Call("POST", path, reader_of(ErrorMapAnswer), error_map, query=accepting(accept_losses))


def preview_error_map(machine: str, error_map: Content) -> Call[PreviewAnswer]:
    """Say what storing a map would do to the tables; nothing is stored."""
    path = of_machine(machine, "error-maps")
    return Call("POST", path, reader_of(PreviewAnswer), error_map, query=PREVIEW)


def error_maps(machine: str) -> Call[list[ErrorMapAnswer]]:
    """List a machine's error maps in the order in which they were stored."""
    return Call("GET", of_machine(machine, "error-maps"), reader_of(list[ErrorMapAnswer]))


def error_map(machine: str, map_id: int) -> Call[ErrorMapAnswer]:
    """Show one error map by its number."""
    return Call("GET", of_machine(machine, "error-maps", map_id), reader_of(ErrorMapAnswer))


def error_map_file(machine: str, map_id: int) -> Call[str]:
    """Write one error map as the CSV file that `import_file` reads."""
    return Call("GET", of_machine(machine, "error-maps", map_id, "file"), _read_text)


def delete_error_map(machine: str, map_id: int) -> Call[None]:
    """Take an error map out of use; older model versions keep it."""
    return Call("DELETE", of_machine(machine, "error-maps", map_id), nothing)


def preview_map_deletion(machine: str, map_id: int) -> Call[PreviewAnswer]:
    """Say what taking an error map out of use would do to the tables; nothing changes."""
    path = of_machine(machine, "error-maps", map_id)
    return Call("DELETE", path, reader_of(PreviewAnswer), query=PREVIEW)


# -- sensor assignment and models ----------------------------------------------------------


def sensor_assignment(machine: str) -> Call[dict[str, str]]:
    """Show which sensor each component follows, component code to sensor."""
    return Call("GET", of_machine(machine, "sensor-assignment"), reader_of(dict[str, str]))


def assign_sensors(
    machine: str, assignment: Mapping[str, str], *, accept_losses: bool = False
) -> Call[dict[str, str] | WaitingAssignmentAnswer]:
    """Assign sensors to components, the others keep theirs; gives the whole assignment.

    Where tables would lose something the version waits, unless `accept_losses`: then the
    answer is a `WaitingAssignmentAnswer`, which says what.
    """
    path = of_machine(machine, "sensor-assignment")
    return Call("PUT", path, _read_assigned, assignment, query=accepting(accept_losses))


def preview_assignment(machine: str, assignment: Mapping[str, str]) -> Call[PreviewAnswer]:
    """Say what an assignment would do to the tables; nothing changes."""
    path = of_machine(machine, "sensor-assignment")
    return Call("PUT", path, reader_of(PreviewAnswer), assignment, query=PREVIEW)


def correlate_sensors(machine: str) -> Call[CorrelationAnswer]:
    """Propose sensors by their correlation with the maps; nothing changes."""
    path = of_machine(machine, "sensor-assignment", "correlate")
    return Call("POST", path, reader_of(CorrelationAnswer))


def models(machine: str) -> Call[list[ModelAnswer]]:
    """List all model versions, oldest first."""
    return Call("GET", of_machine(machine, "models"), reader_of(list[ModelAnswer]))


def model(machine: str, version: int) -> Call[ModelAnswer]:
    """Show one model version."""
    return Call("GET", of_machine(machine, "models", version), reader_of(ModelAnswer))


def model_coverage(machine: str, version: int) -> Call[ModelCoverageAnswer]:
    """Show which components the tables of a version have, and why they lack others."""
    path = of_machine(machine, "models", version, "coverage")
    return Call("GET", path, reader_of(ModelCoverageAnswer))


def activate_model(machine: str, version: int) -> Call[ChangedModelAnswer]:
    """Compute tables with this version from now on; the answer says what they lose."""
    path = of_machine(machine, "models", version, "activate")
    return Call("POST", path, reader_of(ChangedModelAnswer))


def preview_activation(machine: str, version: int) -> Call[PreviewAnswer]:
    """Say what activating a version would do to the tables; nothing changes."""
    path = of_machine(machine, "models", version, "activate")
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
    machine: str,
    since: datetime | str | None = None,
    until: datetime | str | None = None,
    every_s: float | None = None,
    limit: int | None = None,
) -> Call[list[ReadingSchema]]:
    """List readings in order of time, at most one in `every_s` seconds [s]."""
    query = {"from": since, "to": until, "every_s": every_s, "limit": limit}
    return Call("GET", of_machine(machine, "readings"), reader_of(list[ReadingSchema]), query=query)


def history(
    machine: str,
    since: datetime | str | None = None,
    until: datetime | str | None = None,
    *,
    sensors: Sequence[str] = (),
    component: str | None = None,
    position_mm: float | None = None,
    points: int | None = None,
    residuals: bool = False,
) -> Call[History]:
    """Show temperatures over hours to years in bins, checks, events, and more if it is wanted.

    Parameters
    ----------
    component, position_mm
        Where the compensation is wanted, too [mm].
    points
        At most about so many bins.
    residuals
        Whether it is wanted what the active version leaves of the latest checks.
    """
    query = {
        "from": since,
        "to": until,
        "sensor": list(sensors) or None,
        "component": component,
        "position_mm": position_mm,
        "points": points,
        "residuals": "true" if residuals else None,
    }
    return Call("GET", of_machine(machine, "history"), reader_of(History), query=query)


def withdrawn_readings(
    machine: str,
    since: datetime | str | None = None,
    until: datetime | str | None = None,
    limit: int | None = None,
) -> Call[list[WithdrawnReadingAnswer]]:
    """List the readings that were withdrawn, in order of their times."""
    path = of_machine(machine, "readings", "withdrawn")
    query = {"from": since, "to": until, "limit": limit}
    return Call("GET", path, reader_of(list[WithdrawnReadingAnswer]), query=query)


def withdraw_reading(machine: str, time: datetime | str) -> Call[WithdrawnReadings]:
    """Take the reading of exactly this time out of use; UnknownThingError if there is none."""
    path = of_machine(machine, "readings")
    return Call("DELETE", path, reader_of(WithdrawnReadings), query={"time": time})


def withdraw_readings(
    machine: str, since: datetime | str, until: datetime | str
) -> Call[WithdrawnReadings]:
    """Take all readings between two times, both included, out of use."""
    query = {"from": since, "to": until}
    return Call(
        "DELETE", of_machine(machine, "readings"), reader_of(WithdrawnReadings), query=query
    )


def compensation(
    machine: str, temperatures_c: Mapping[str, float], state: Mapping[str, float] | None = None
) -> Call[CompensationAnswer]:
    """Compute the table at these temperatures, sensor to temperature [°C]."""
    body = {"temperatures_c": temperatures_c, "state": state or {}}
    return Call("POST", of_machine(machine, "compensation"), reader_of(CompensationAnswer), body)


def controllers() -> Call[ControllersAnswer]:
    """List the controllers' file formats, with sign, units, limits and options."""
    return Call("GET", "/v1/controllers", reader_of(ControllersAnswer))


def export_compensation(
    machine: str, controller: str, question: Content | None = None
) -> Call[ExportAnswer]:
    """Write a controller's files as an `ExportRequest` asks; at the latest reading without."""
    return Call(
        "POST",
        of_machine(machine, "compensation/export"),
        reader_of(ExportAnswer),
        question or {},
        query={"controller": controller},
    )


def compare_compensation(machine: str, controller: str, question: Content) -> Call[CompareAnswer]:
    """Compare the files of a `CompareRequest` with what they should hold."""
    return Call(
        "POST",
        of_machine(machine, "compensation/compare"),
        reader_of(CompareAnswer),
        question,
        query={"controller": controller},
    )


def parse_controller_files(controller: str, question: Content) -> Call[ParseAnswer]:
    """Read the files of a `ParseRequest`."""
    path = f"/v1/controllers/{quote(controller, safe='')}/parse"
    return Call("POST", path, reader_of(ParseAnswer), question)


def current_table(machine: str, etag: str | None = None) -> Call[TaggedTable | None]:
    """Compute the table at the latest reading; None while it is the one of this ETag.

    Raises
    ------
    ConflictError
        If there is no reading yet, or no sensor that can be believed.
    """
    return Call(
        "GET",
        of_machine(machine, "compensation"),
        _read_tagged,
        headers={"If-None-Match": etag} if etag else {},
        answered_by=frozenset({304}),
    )


def predict(
    machine: str,
    observations: Sequence[Content],
    model_version: int | None = None,
    missing_components: str = "refuse",
) -> Call[PredictionAnswer]:
    """Predict the error of each `ObservationSchema` with the stored readings."""
    body: dict[str, Any] = {"observations": list(observations)}
    body["missing_components"] = missing_components
    if model_version is not None:
        body["model_version"] = model_version
    return Call("POST", of_machine(machine, "predictions"), reader_of(PredictionAnswer), body)


# -- geometry ------------------------------------------------------------------------------


def volumetric_error(machine: str, question: Content) -> Call[VolumetricErrors]:
    """Sum all errors at the points of a `VolumetricErrorRequest`, as numpy arrays."""
    needs("numpy", "volumetric_error")
    path = of_machine(machine, "volumetric-error")
    return Call("POST", path, _read_vectors, question, headers={"Accept": NPY})


def grid(machine: str, question: Content) -> Call[GridAnswer]:
    """Give the corner values of a `GridRequest`'s grid, or of one that keeps a tolerance."""
    path = of_machine(machine, "compensation", "grid")
    return Call("POST", path, reader_of(GridAnswer), question)


def volumetric_accuracy(machine: str, question: Content) -> Call[AccuracyAnswer]:
    """Measure the work volume by every definition, as an `AccuracyRequest` asks."""
    path = of_machine(machine, "volumetric-accuracy")
    return Call("POST", path, reader_of(AccuracyAnswer), question)


def accuracy_from_lines(lines: Content) -> Call[LinesAnswer]:
    """Compute ELv and ELSv of a `LinesRequest`."""
    return Call("POST", "/v1/volumetric-accuracy/from-lines", reader_of(LinesAnswer), lines)


def compensation_levels(machine: str, question: Content) -> Call[LevelsAnswer]:
    """Say what controllers of different ability would leave of the volumetric error."""
    path = of_machine(machine, "compensation", "levels")
    return Call("POST", path, reader_of(LevelsAnswer), question)


def rotary_axis_error(machine: str, question: Content) -> Call[RotaryErrorAnswer]:
    """Say what location errors of rotary axes do to a `RotaryErrorRequest`'s points."""
    path = of_machine(machine, "rotary-axis-error")
    return Call("POST", path, reader_of(RotaryErrorAnswer), question)


def current_picture(machine: str, missing_components: str = "refuse") -> Call[str]:
    """Draw the work volume at the latest reading: a page that needs the service's files."""
    query = {"missing_components": missing_components}
    return Call(
        "GET", of_machine(machine, "picture"), _read_text, query=query, headers={"Accept": HTML}
    )


def picture(machine: str, question: Content) -> Call[dict[str, Any]]:
    """Draw the work volume as a `PictureRequest` asks: a plotly figure."""
    return Call("POST", of_machine(machine, "picture"), reader_of(dict[str, Any]), question)


# -- measurements --------------------------------------------------------------------------


def file_template(machine: str, kind: Literal["map", "check"] = "map") -> Call[str]:
    """Write an empty file of the machine's sensors, axes and components, as CSV."""
    path = of_machine(machine, "files", "template")
    return Call("GET", path, _read_text, query={"kind": kind})


def send_file(
    machine_id: str, name: str, content: bytes, beside: Mapping[str, Any], storing: Storing
) -> Call[ImportedFile]:
    """POST …/files; `beside` is what is said of the file beside it."""
    query = {"name": name, **beside, **storing.query}
    query |= {} if storing.store else {"store": "false"}
    return Call("POST", of_machine(machine_id, "files"), reader_of(_SENT), content, query=query)


def import_file(
    machine: str,
    path: str | Path,
    *,
    kind: Literal["map", "check"] | None = None,
    label: str | None = None,
    measured_at: datetime | str | None = None,
    temperatures_c: Mapping[str, float] | None = None,
    axis: str | None = None,
    method: str | None = None,
    store: bool = True,
    preview: bool = False,
    accept_losses: bool = False,
    store_verification: bool = False,
) -> Call[ImportedFile]:
    """Store a file: an error map, an instrument's readings, or check measurements.

    The service recognises which, and answers as it does to them. With `preview` nothing is
    stored, and the answer says how the file was read or what a map would change.

    Parameters
    ----------
    kind
        What it holds, where the file itself does not say.
    label, measured_at, temperatures_c, axis
        Of a map, where its file has none: name, time, every sensor's temperature [°C], axis.
    method
        By which method it was measured, where it is a table of readings (`positioning` …); the
        answer is that of `measure` then.
    store
        Whether a map is stored; readings may be evaluated alone.
    store_verification
        Whether the course of a drift test becomes a verification.
    """
    beside = {
        "kind": kind,
        "label": label,
        "measured_at": measured_at,
        "temperature": [f"{name}={value}" for name, value in (temperatures_c or {}).items()],
        "axis": axis,
        "method": method,
    }
    storing = Storing(store, accept_losses, preview, store_verification)
    file = Path(path)
    content = file.read_bytes()
    return send_file(machine, file.name, content, beside, storing)


def measure(
    machine: str,
    method: str,
    measurement: Content,
    *,
    store: bool = False,
    accept_losses: bool = False,
    preview: bool = False,
    store_verification: bool = False,
) -> Call[MeasurementAnswer]:
    """Evaluate a measurement by a method: `positioning`, `step-diagonal` … with its request.

    The answer is the method's own, such as a `PositioningAnswer` of a `PositioningRequest`.

    Parameters
    ----------
    store
        Whether it becomes an error map.
    store_verification
        Whether the course of a drift test becomes a verification.
    """
    storing = Storing(store, accept_losses, preview, store_verification)
    path = of_machine(machine, "measurements", quote(method, safe=""))
    query = {"store": "true" if store else "false"} | storing.query
    return Call("POST", path, reader_of(_MEASURED), measurement, query=query)


def simulate_step_diagonal(machine: str, plan: Content) -> Call[SimulatedStepDiagonal]:
    """Say what a laser would read on the stored machine in a `StepDiagonalSimulation`."""
    path = of_machine(machine, "measurements", "step-diagonal", "simulate")
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
