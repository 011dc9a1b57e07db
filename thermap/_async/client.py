"""The client: one method a route.

`scripts/write_client.py` makes the blocking client of this one.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Collection, Iterable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import httpx

from thermap import calls, following, loop_calls
from thermap.answers import (
    AccessKey,
    AccuracyAnswer,
    AnalysisAnswer,
    AnalysisHead,
    BodyDiagonalAnswer,
    ChangedModelAnswer,
    CompareAnswer,
    CompensationAnswer,
    ConnectionsNow,
    ControllersAnswer,
    CorrelationAnswer,
    DrilledPlateAnswer,
    ErrorMapAnswer,
    Events,
    ExportAnswer,
    FleetAnswer,
    GridAnswer,
    HealthAnswer,
    History,
    LevelsAnswer,
    LinesAnswer,
    MachineAnswer,
    MachinedPartAnswer,
    MachineStatus,
    MeasurementAnswer,
    ModelAnswer,
    ModelComparisonAnswer,
    ModelCoverageAnswer,
    NeededAnswer,
    NewAccessKey,
    ParseAnswer,
    PlanAnswer,
    PositioningAnswer,
    PredictionAnswer,
    PresetAnswer,
    PreviewAnswer,
    ReadingSchema,
    ReadyAnswer,
    Receiver,
    Receivers,
    ResidualsAnswer,
    RotaryAxisAnswer,
    RotaryErrorAnswer,
    SimulatedStepDiagonal,
    StepDiagonalAnswer,
    StoredReadings,
    StoredVerificationAnswer,
    ThermalDriftAnswer,
    TriedEffectAnswer,
    VerificationAnswer,
    WaitingAssignmentAnswer,
    WatchAnswer,
    WholeVerificationAnswer,
    WithdrawnReadingAnswer,
    WithdrawnReadings,
)
from thermap.call import Answer, Call, Content
from thermap.calls import TaggedTable, VolumetricErrors
from thermap.connection import explaining, httpx_options, service_url, without_password
from thermap.errors import ServiceUnavailableError, error_of
from thermap.following import EventReader, Followed, Told


class AsyncThermapClient:
    """A thermap service, one method a route.

    Parameters
    ----------
    base_url
        Where the service is; THERMAP_URL in the environment or http://127.0.0.1:8000
        where nothing is stated.
    key
        What the service asks for where it asks for keys; THERMAP_KEY in the environment where
        none is stated.
    timeout_s
        Longest wait for an answer [s]; a plan is waited for ten minutes.
    transport
        How requests travel; for tests.

    Raises
    ------
    ThermapClientError
        By every method, of the kind that `thermap.errors` draws.

    Notes
    -----
    Bodies are mappings, or the shapes of `thermap.requests` with the same fields; numpy
    arrays may stand wherever a list of numbers may. Safe to share by threads.
    """

    def __init__(
        self,
        base_url: str | None = None,
        *,
        key: str | None = None,
        timeout_s: float = 30.0,
        transport: httpx.AsyncBaseTransport | None = None,
    ) -> None:
        self._url = service_url(base_url)
        self._timeout_s = timeout_s
        self._http = httpx.AsyncClient(
            transport=transport, **httpx_options(self._url, timeout_s, key)
        )

    @property
    def base_url(self) -> str:
        """Where the service is, without a password."""
        return without_password(self._url)

    async def health(self) -> HealthAnswer:
        """Ask whether the process lives, and its version."""
        return await self.send(calls.health())

    async def ready(self) -> ReadyAnswer:
        """Ask whether the database is there and every model in memory; not being so is no error."""
        return await self.send(calls.ready())

    async def metrics(self) -> str:
        """Read the metrics in Prometheus' text format."""
        return await self.send(calls.metrics())

    async def keys(self) -> list[AccessKey]:
        """List the service's keys by name, with their last use; for admins."""
        return await self.send(calls.keys())

    async def create_key(
        self, name: str, role: str, machines: Sequence[str] | None = None
    ) -> NewAccessKey:
        """Make a key, for these machines or for all; its `secret` is shown this once."""
        return await self.send(calls.create_key(name, role, machines))

    async def revoke_key(self, name: str, *, last_admin: bool = False) -> None:
        """Let a key be none any more; ConflictError for an admin's last, unless `last_admin`."""
        return await self.send(calls.revoke_key(name, last_admin))

    async def create_machine(self, settings: Content) -> MachineAnswer:
        """Create a machine from a `MachineSettings`; ConflictError if its id is taken."""
        return await self.send(calls.create_machine(settings))

    async def machines(self) -> list[MachineAnswer]:
        """List all machines by id."""
        return await self.send(calls.machines())

    async def machine(self, machine: str) -> MachineAnswer:
        """Show one machine."""
        return await self.send(calls.machine(machine))

    async def statuses(self) -> list[MachineStatus]:
        """Say of every machine whether it can be trusted now, by id."""
        return await self.send(calls.statuses())

    async def status(self, machine: str) -> MachineStatus:
        """Say whether a machine can be trusted now, and why not."""
        return await self.send(calls.status(machine))

    async def needed_components(
        self, machine: str, preset: str | None = None, tool_length_mm: float = 0.0
    ) -> NeededAnswer:
        """List the errors that have to be measured, of a rigid machine or of a preset."""
        return await self.send(calls.needed_components(machine, preset, tool_length_mm))

    async def nonrigid_presets(self) -> list[PresetAnswer]:
        """List the kinds of machines that are not rigid, and their slopes."""
        return await self.send(calls.nonrigid_presets())

    async def change_machine(self, machine: str, changes: Content) -> MachineAnswer:
        """Change the settings that a `MachinePatch` states."""
        return await self.send(calls.change_machine(machine, changes))

    async def delete_machine(self, machine: str) -> None:
        """Delete a machine with all its maps, models and readings."""
        return await self.send(calls.delete_machine(machine))

    async def store_error_map(
        self, machine: str, error_map: Content, *, accept_losses: bool = False
    ) -> ErrorMapAnswer:
        """Store an `ErrorMapSchema`; the same content again gives the map that is there.

        A model version whose tables would lose something waits, unless `accept_losses`: the
        answer's `activated` is False then, and `loses` and `next_step` say the rest.
        """
        return await self.send(calls.store_error_map(machine, error_map, accept_losses))

    async def preview_error_map(self, machine: str, error_map: Content) -> PreviewAnswer:
        """Say what storing a map would do to the tables; nothing is stored."""
        return await self.send(calls.preview_error_map(machine, error_map))

    async def import_file(
        self,
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
    ) -> calls.ImportedFile:
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
            answer is that of `measure_positioning` … then.
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
        storing = calls.Storing(store, accept_losses, preview, store_verification)
        file = Path(path)
        content = file.read_bytes()
        return await self.send(calls.send_file(machine, file.name, content, beside, storing))

    async def error_maps(self, machine: str) -> list[ErrorMapAnswer]:
        """List a machine's error maps in the order in which they were stored."""
        return await self.send(calls.error_maps(machine))

    async def error_map(self, machine: str, map_id: int) -> ErrorMapAnswer:
        """Show one error map by its number."""
        return await self.send(calls.error_map(machine, map_id))

    async def error_map_file(self, machine: str, map_id: int) -> str:
        """Write one error map as the CSV file that `import_file` reads."""
        return await self.send(calls.error_map_file(machine, map_id))

    async def file_template(self, machine: str, kind: Literal["map", "check"] = "map") -> str:
        """Write an empty file of the machine's sensors, axes and components, as CSV."""
        return await self.send(calls.file_template(machine, kind))

    async def delete_error_map(self, machine: str, map_id: int) -> None:
        """Take an error map out of use; older model versions keep it."""
        return await self.send(calls.delete_error_map(machine, map_id))

    async def preview_map_deletion(self, machine: str, map_id: int) -> PreviewAnswer:
        """Say what taking an error map out of use would do to the tables; nothing changes."""
        return await self.send(calls.preview_map_deletion(machine, map_id))

    async def sensor_assignment(self, machine: str) -> dict[str, str]:
        """Show which sensor each component follows, component code to sensor."""
        return await self.send(calls.sensor_assignment(machine))

    async def assign_sensors(
        self,
        machine: str,
        assignment: Mapping[str, str],
        *,
        accept_losses: bool = False,
    ) -> dict[str, str] | WaitingAssignmentAnswer:
        """Assign sensors to components, the others keep theirs; gives the whole assignment.

        Where tables would lose something the version waits, unless `accept_losses`: then the
        answer is a `WaitingAssignmentAnswer`, which says what.
        """
        return await self.send(calls.assign_sensors(machine, assignment, accept_losses))

    async def preview_assignment(
        self, machine: str, assignment: Mapping[str, str]
    ) -> PreviewAnswer:
        """Say what an assignment would do to the tables; nothing changes."""
        return await self.send(calls.preview_assignment(machine, assignment))

    async def correlate_sensors(self, machine: str) -> CorrelationAnswer:
        """Propose sensors by their correlation with the maps; nothing changes."""
        return await self.send(calls.correlate_sensors(machine))

    async def models(self, machine: str) -> list[ModelAnswer]:
        """List all model versions, oldest first."""
        return await self.send(calls.models(machine))

    async def model(self, machine: str, version: int) -> ModelAnswer:
        """Show one model version."""
        return await self.send(calls.model(machine, version))

    async def model_coverage(self, machine: str, version: int) -> ModelCoverageAnswer:
        """Show which components the tables of a version have, and why they lack others."""
        return await self.send(calls.model_coverage(machine, version))

    async def activate_model(self, machine: str, version: int) -> ChangedModelAnswer:
        """Compute tables with this version from now on; the answer says what they lose."""
        return await self.send(calls.activate_model(machine, version))

    async def preview_activation(self, machine: str, version: int) -> PreviewAnswer:
        """Say what activating a version would do to the tables; nothing changes."""
        return await self.send(calls.preview_activation(machine, version))

    async def store_readings(
        self, machine: str, readings: Content | Iterable[Content]
    ) -> StoredReadings:
        """Store one `ReadingSchema` or any number of them.

        They travel in parts of 10,000, each stored whole or not at all. After an
        error the same list may be sent again: what is there counts as duplicates.
        """
        parts = calls.store_readings(machine, readings)
        return calls.add_up([await self.send(part) for part in parts])

    async def readings(
        self,
        machine: str,
        since: datetime | str | None = None,
        until: datetime | str | None = None,
        every_s: float | None = None,
        limit: int | None = None,
    ) -> list[ReadingSchema]:
        """List readings in order of time, at most one in `every_s` seconds [s]."""
        return await self.send(calls.readings(machine, since, until, every_s, limit))

    async def history(
        self,
        machine: str,
        since: datetime | str | None = None,
        until: datetime | str | None = None,
        *,
        sensors: Sequence[str] = (),
        component: str | None = None,
        position_mm: float | None = None,
        points: int | None = None,
        residuals: bool = False,
    ) -> History:
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
        arguments = (machine, since, until, sensors, component, position_mm, points)
        return await self.send(calls.history(*arguments, residuals=residuals))

    async def connections(self) -> ConnectionsNow:
        """Say how what the service reads beside HTTP fares."""
        return await self.send(calls.connections())

    async def receivers(self) -> Receivers:
        """List who is told of alarms, and how that went."""
        return await self.send(calls.receivers())

    async def test_receiver(self, name: str) -> Receiver:
        """Ask for a test message; whether it arrived, `receivers` says some seconds later."""
        return await self.send(calls.test_receiver(name))

    async def events(
        self,
        machine: str,
        *,
        since: datetime | str | None = None,
        until: datetime | str | None = None,
        kinds: Sequence[str] = (),
        before: str | None = None,
        limit: int | None = None,
    ) -> Events:
        """List what happened to a machine, the newest first.

        Parameters
        ----------
        kinds
            `model`, `alarm`, `sensor` …; none for all.
        before
            `next` of the answer before, for those that come after it in the list.
        """
        return await self.send(calls.events(machine, since, until, kinds, before, limit))

    async def all_events(
        self,
        *,
        since: datetime | str | None = None,
        until: datetime | str | None = None,
        kinds: Sequence[str] = (),
        before: str | None = None,
        limit: int | None = None,
    ) -> Events:
        """List what happened to all machines, and to keys; parameters as for `events`."""
        return await self.send(calls.all_events(since, until, kinds, before, limit))

    async def withdrawn_readings(
        self,
        machine: str,
        since: datetime | str | None = None,
        until: datetime | str | None = None,
        limit: int | None = None,
    ) -> list[WithdrawnReadingAnswer]:
        """List the readings that were withdrawn, in order of their times."""
        return await self.send(calls.withdrawn_readings(machine, since, until, limit))

    async def withdraw_reading(self, machine: str, time: datetime | str) -> WithdrawnReadings:
        """Take the reading of exactly this time out of use; UnknownThingError if there is none."""
        return await self.send(calls.withdraw_reading(machine, time))

    async def withdraw_readings(
        self, machine: str, since: datetime | str, until: datetime | str
    ) -> WithdrawnReadings:
        """Take all readings between two times, both included, out of use."""
        return await self.send(calls.withdraw_readings(machine, since, until))

    async def compensation(
        self,
        machine: str,
        temperatures_c: Mapping[str, float],
        state: Mapping[str, float] | None = None,
    ) -> CompensationAnswer:
        """Compute the table at these temperatures, sensor to temperature [°C]."""
        return await self.send(calls.compensation(machine, temperatures_c, state))

    async def current_table(self, machine: str, etag: str | None = None) -> TaggedTable | None:
        """Compute the table at the latest reading; None while it is the one of this ETag.

        Raises
        ------
        ConflictError
            If there is no reading yet, or no sensor that can be believed.
        """
        return await self.send(calls.current_table(machine, etag))

    async def predict(
        self,
        machine: str,
        observations: Sequence[Content],
        model_version: int | None = None,
        missing_components: str = "refuse",
    ) -> PredictionAnswer:
        """Predict the error of each `ObservationSchema` with the stored readings."""
        return await self.send(
            calls.predict(machine, observations, model_version, missing_components)
        )

    async def volumetric_error(self, machine: str, question: Content) -> VolumetricErrors:
        """Sum all errors at the points of a `VolumetricErrorRequest`, as numpy arrays."""
        return await self.send(calls.volumetric_error(machine, question))

    async def grid(self, machine: str, question: Content) -> GridAnswer:
        """Give the corner values of a `GridRequest`'s grid, or of one that keeps a tolerance."""
        return await self.send(calls.grid(machine, question))

    async def volumetric_accuracy(self, machine: str, question: Content) -> AccuracyAnswer:
        """Measure the work volume by every definition, as an `AccuracyRequest` asks."""
        return await self.send(calls.volumetric_accuracy(machine, question))

    async def accuracy_from_lines(self, lines: Content) -> LinesAnswer:
        """Compute ELv and ELSv of a `LinesRequest`."""
        return await self.send(calls.accuracy_from_lines(lines))

    async def controllers(self) -> ControllersAnswer:
        """List the controllers' file formats, with sign, units, limits and options."""
        return await self.send(calls.controllers())

    async def export_compensation(
        self, machine: str, controller: str, question: Content | None = None
    ) -> ExportAnswer:
        """Write a controller's files as an `ExportRequest` asks; at the latest reading without."""
        return await self.send(calls.export_compensation(machine, controller, question))

    async def compare_compensation(
        self, machine: str, controller: str, question: Content
    ) -> CompareAnswer:
        """Compare the files of a `CompareRequest` with what they should hold."""
        return await self.send(calls.compare_compensation(machine, controller, question))

    async def parse_controller_files(self, controller: str, question: Content) -> ParseAnswer:
        """Read the files of a `ParseRequest`."""
        return await self.send(calls.parse_controller_files(controller, question))

    async def compensation_levels(self, machine: str, question: Content) -> LevelsAnswer:
        """Say what controllers of different ability would leave of the volumetric error."""
        return await self.send(calls.compensation_levels(machine, question))

    async def rotary_axis_error(self, machine: str, question: Content) -> RotaryErrorAnswer:
        """Say what location errors of rotary axes do to a `RotaryErrorRequest`'s points."""
        return await self.send(calls.rotary_axis_error(machine, question))

    async def current_picture(self, machine: str, missing_components: str = "refuse") -> str:
        """Draw the work volume at the latest reading: a page that needs the service's files."""
        return await self.send(calls.current_picture(machine, missing_components))

    async def picture(self, machine: str, question: Content) -> dict[str, Any]:
        """Draw the work volume as a `PictureRequest` asks: a plotly figure."""
        return await self.send(calls.picture(machine, question))

    async def measure_step_diagonal(
        self,
        machine: str,
        measurement: Content,
        *,
        store: bool = False,
        accept_losses: bool = False,
        preview: bool = False,
    ) -> StepDiagonalAnswer:
        """Derive translations and squareness from a `StepDiagonalRequest`'s readings."""
        storing = calls.Storing(store, accept_losses, preview)
        return await self.send(
            calls.measure(machine, "step-diagonal", StepDiagonalAnswer, measurement, storing)
        )

    async def measure_body_diagonal(
        self,
        machine: str,
        measurement: Content,
        *,
        store: bool = False,
        accept_losses: bool = False,
        preview: bool = False,
    ) -> BodyDiagonalAnswer:
        """Evaluate Ed, ESd and squareness of a `BodyDiagonalRequest`'s readings."""
        storing = calls.Storing(store, accept_losses, preview)
        return await self.send(
            calls.measure(machine, "body-diagonal", BodyDiagonalAnswer, measurement, storing)
        )

    async def measure_positioning(
        self,
        machine: str,
        measurement: Content,
        *,
        store: bool = False,
        accept_losses: bool = False,
        preview: bool = False,
    ) -> PositioningAnswer:
        """Evaluate a `PositioningRequest`'s runs by ISO 230-2."""
        storing = calls.Storing(store, accept_losses, preview)
        return await self.send(
            calls.measure(machine, "positioning", PositioningAnswer, measurement, storing)
        )

    async def measure_six_dof(
        self,
        machine: str,
        measurement: Content,
        *,
        store: bool = False,
        accept_losses: bool = False,
        preview: bool = False,
    ) -> MeasurementAnswer:
        """Take up to six errors of one axis from a `SixDofRequest`."""
        storing = calls.Storing(store, accept_losses, preview)
        return await self.send(
            calls.measure(machine, "six-dof", MeasurementAnswer, measurement, storing)
        )

    async def measure_machined_part(
        self,
        machine: str,
        measurement: Content,
        *,
        store: bool = False,
        accept_losses: bool = False,
        preview: bool = False,
    ) -> MachinedPartAnswer:
        """Take a `MachinedPartRequest`'s straightness, and compare it with the model."""
        storing = calls.Storing(store, accept_losses, preview)
        return await self.send(
            calls.measure(machine, "machined-part", MachinedPartAnswer, measurement, storing)
        )

    async def measure_drilled_plate(
        self,
        machine: str,
        measurement: Content,
        *,
        store: bool = False,
        accept_losses: bool = False,
        preview: bool = False,
    ) -> DrilledPlateAnswer:
        """Take scale, squareness and axis errors from a `DrilledPlateRequest`'s holes."""
        storing = calls.Storing(store, accept_losses, preview)
        return await self.send(
            calls.measure(machine, "drilled-plate", DrilledPlateAnswer, measurement, storing)
        )

    async def measure_rotary_axis(
        self,
        machine: str,
        measurement: Content,
        *,
        store: bool = False,
        accept_losses: bool = False,
        preview: bool = False,
    ) -> RotaryAxisAnswer:
        """Find a rotary axis from a `RotaryAxisRequest`'s places of a ball."""
        storing = calls.Storing(store, accept_losses, preview)
        return await self.send(
            calls.measure(machine, "rotary-axis", RotaryAxisAnswer, measurement, storing)
        )

    async def measure_thermal_drift(
        self,
        machine: str,
        measurement: Content,
        *,
        store: bool = False,
        store_verification: bool = False,
        accept_losses: bool = False,
        preview: bool = False,
    ) -> ThermalDriftAnswer:
        """Evaluate a `ThermalDriftRequest` by ISO 230-3; keep maps, a verification, or both."""
        storing = calls.Storing(store, accept_losses, preview, store_verification)
        return await self.send(
            calls.measure(machine, "thermal-drift", ThermalDriftAnswer, measurement, storing)
        )

    async def simulate_step_diagonal(self, machine: str, plan: Content) -> SimulatedStepDiagonal:
        """Say what a laser would read on the stored machine in a `StepDiagonalSimulation`."""
        return await self.send(calls.simulate_step_diagonal(machine, plan))

    async def store_verification(
        self, machine: str, verification: Content
    ) -> StoredVerificationAnswer:
        """Store a `VerificationRequest`: observations to hold the model against."""
        return await self.send(loop_calls.store_verification(machine, verification))

    async def verifications(self, machine: str) -> list[VerificationAnswer]:
        """List verifications without their observations, oldest first."""
        return await self.send(loop_calls.verifications(machine))

    async def verification(self, machine: str, verification_id: int) -> WholeVerificationAnswer:
        """Show one verification with its observations."""
        return await self.send(loop_calls.verification(machine, verification_id))

    async def verification_file(self, machine: str, verification_id: int) -> str:
        """Write one verification as the CSV file that `import_file` reads."""
        return await self.send(loop_calls.verification_file(machine, verification_id))

    async def delete_verification(self, machine: str, verification_id: int) -> None:
        """Delete a verification; analyses of it keep their results."""
        return await self.send(loop_calls.delete_verification(machine, verification_id))

    async def watch(self, machine: str) -> WatchAnswer:
        """Say whether the machine still is as its model says, by a sequential test."""
        return await self.send(loop_calls.watch(machine))

    async def verification_residuals(
        self, machine: str, verification_id: int, model_version: int | None = None, rows: int = 0
    ) -> ResidualsAnswer:
        """Subtract what a model version says from one verification, with so many single rows."""
        return await self.send(
            loop_calls.verification_residuals(machine, verification_id, model_version, rows)
        )

    async def residuals(
        self,
        machine: str,
        verifications: Sequence[int],
        model_version: int | None = None,
        rows: int = 0,
    ) -> ResidualsAnswer:
        """Do the same with several verifications together."""
        return await self.send(loop_calls.residuals(machine, verifications, model_version, rows))

    async def residuals_page(
        self, machine: str, verifications: Sequence[int], model_version: int | None = None
    ) -> str:
        """Read residuals as a page for a person: HTML that needs no other file."""
        return await self.send(loop_calls.residuals_page(machine, verifications, model_version))

    async def compare_models(
        self, machine: str, verifications: Sequence[int], versions: Sequence[int]
    ) -> ModelComparisonAnswer:
        """Show versions side by side, on the observations that all can be held against."""
        return await self.send(loop_calls.compare_models(machine, verifications, versions))

    async def analyse(self, machine: str, question: Content) -> AnalysisHead:
        """Ask for an analysis with an `AnalysisRequest`; look at it until it is done."""
        return await self.send(loop_calls.analyse(machine, question))

    async def plan_analysis(self, machine: str, plan: Content) -> PlanAnswer:
        """Say what the observations of a `PlanRequest` could see, before anyone measures."""
        return await self.send(loop_calls.plan_analysis(machine, plan))

    async def fleet(
        self, effects: Sequence[str] | None = None, holdout_fraction: float = 0.3
    ) -> FleetAnswer:
        """Say how far the analyses of all machines are, and what they say together."""
        return await self.send(loop_calls.fleet(effects, holdout_fraction))

    async def analyse_fleet(self, question: Content) -> FleetAnswer:
        """Ask for the analyses that are missing with a `FleetRequest`."""
        return await self.send(loop_calls.analyse_fleet(question))

    async def cancel_fleet(self, question: Content) -> FleetAnswer:
        """Cancel those that wait or run of the analyses that asked a `FleetRequest`."""
        return await self.send(loop_calls.cancel_fleet(question))

    async def try_effect(self, question: Content) -> TriedEffectAnswer:
        """Hold an effect that was found on one machine, as it stands, against another one."""
        return await self.send(loop_calls.try_effect(question))

    async def analyses(self, machine: str) -> list[AnalysisHead]:
        """List analyses without their results, oldest first."""
        return await self.send(loop_calls.analyses(machine))

    async def analysis(self, machine: str, analysis_id: int) -> AnalysisAnswer:
        """Show how far an analysis is and, once it is done, what it found."""
        return await self.send(loop_calls.analysis(machine, analysis_id))

    async def wait_for_analysis(
        self,
        machine: str,
        analysis_id: int,
        *,
        progress: loop_calls.Progress | None = None,
        timeout_s: float | None = None,
    ) -> AnalysisAnswer:
        """Wait until an analysis is done, and give what it found.

        Parameters
        ----------
        progress
            Called at every look, some a second, with the share that is done, 0 to 1, and what is
            being done.
        timeout_s
            Longest wait [s]; None for as long as it takes.

        Raises
        ------
        NotAnalysedError
            If it failed or was cancelled.
        TimeoutError
            If it is not done in time; it goes on nevertheless.
        """
        waiting = loop_calls.Waiting(progress, timeout_s)
        while waiting.goes_on(job := await self.analysis(machine, analysis_id)):
            await asyncio.sleep(loop_calls.POLL_S)
        return job

    async def analysis_report(self, machine: str, analysis_id: int) -> str:
        """Read an analysis as a page for a person: HTML that needs no other file."""
        return await self.send(loop_calls.analysis_report(machine, analysis_id))

    async def visits_page(self, machine: str, analysis_id: int) -> str:
        """Read the visits that an analysis proposes as a page to print and to write on."""
        return await self.send(loop_calls.visits_page(machine, analysis_id))

    async def visit_file(self, machine: str, analysis_id: int, visit: int) -> str:
        """Write a visit that an analysis proposes, from 1, as the CSV file that planning reads."""
        return await self.send(loop_calls.visit_file(machine, analysis_id, visit))

    async def cancel_analysis(self, machine: str, analysis_id: int) -> AnalysisHead:
        """Cancel an analysis that waits or runs."""
        return await self.send(loop_calls.cancel_analysis(machine, analysis_id))

    async def delete_analysis(self, machine: str, analysis_id: int) -> None:
        """Delete an analysis; a model version that was made of it stays."""
        return await self.send(loop_calls.delete_analysis(machine, analysis_id))

    async def adopt_analysis(
        self,
        machine: str,
        analysis_id: int,
        effects: Sequence[int] | None = None,
        *,
        onto_active: bool = False,
        accept_losses: bool = False,
    ) -> ChangedModelAnswer:
        """Make the next, active model version with effects that an analysis found."""
        return await self.send(
            loop_calls.adopt_analysis(machine, analysis_id, effects, onto_active, accept_losses)
        )

    async def preview_adoption(
        self,
        machine: str,
        analysis_id: int,
        effects: Sequence[int] | None = None,
        *,
        onto_active: bool = False,
    ) -> PreviewAnswer:
        """Say what adopting effects would do to the tables; nothing changes."""
        return await self.send(
            loop_calls.preview_adoption(machine, analysis_id, effects, onto_active)
        )

    def follow(
        self,
        machine: str,
        *,
        min_change_um: float = 0.1,
        max_step_um: float | None = None,
        kinds: Collection[Followed] = following.TABLES,
    ) -> AsyncIterator[Told]:
        """Follow a machine's table and verdict as they change, for as long as one iterates.

        A table comes when a value has changed by more than `min_change_um`; with `max_step_um`
        a larger change comes in several tables, one a second [both µm; angular components µrad,
        squareness µm/m]. Once it has begun, a service that is gone is told as `lost`, and asked
        again until it is back; a machine that is deleted ends it with UnknownThingError.

        With `kinds` one may also follow what comes into the event log, `event`, `watch` and
        `analysis`: from now on, and after a break from where that was, each once.
        """
        query = following.query_of(min_change_um, max_step_um, kinds)
        return self._follow(calls.of_machine(machine, "compensation/stream"), query)

    def follow_all(
        self,
        *,
        min_change_um: float = 0.1,
        max_step_um: float | None = None,
        kinds: Collection[Followed] = following.TABLES,
    ) -> AsyncIterator[Told]:
        """Follow all machines, also those that are made later; as `follow` does one."""
        query = following.query_of(min_change_um, max_step_um, kinds)
        return self._follow("/v1/stream", query)

    async def send(self, call: Call[Answer]) -> Answer:
        """Send a call that `thermap.calls` describes, and read its answer."""
        return call.answer(await self._exchange(call))

    async def content(self, call: Call[Any]) -> bytes:
        """Send a call and return its answer's bytes as they came."""
        return call.checked(await self._exchange(call)).content

    async def aclose(self) -> None:
        """Give up the connections."""
        await self._http.aclose()

    async def __aenter__(self) -> Self:
        """Use the client in a `with` block, which closes it."""
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close at the end of a `with` block."""
        await self.aclose()

    async def _follow(self, path: str, query: Mapping[str, Any]) -> AsyncIterator[Told]:
        reader = EventReader()
        while True:
            request = self._http.build_request(
                "GET",
                path,
                params=dict(query),
                headers=dict(reader.headers),
                timeout=following.timeout_of(self._timeout_s),
            )
            try:
                with explaining(self._url, following.SILENT_S):
                    response = await self._http.send(request, stream=True)
                    try:
                        if not response.is_success:
                            await response.aread()
                            raise error_of(response)
                        reader.begin()
                        async for line in response.aiter_lines():
                            event = reader.take(line)
                            if event is not None:
                                yield event
                    finally:
                        await response.aclose()
                why = f"{self.base_url} ended the stream"
            except ServiceUnavailableError as error:
                if not reader.has_begun:
                    raise
                why = error.detail
            lost = reader.lost(why)
            if lost is not None:
                yield lost
            await asyncio.sleep(reader.pause_s())

    async def _exchange(self, call: Call[Any]) -> httpx.Response:
        with explaining(self._url, call.waits_s(self._timeout_s)):
            return await self._http.request(**call.request(self._timeout_s))
