"""The client for asyncio: the same methods, to be awaited."""
# ruff: noqa: D102 -- each method's docstring is that of the blocking client's

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from inspect import getdoc
from types import TracebackType
from typing import Any, Self

import httpx

from app.api.schemas.accuracy import AccuracyAnswer, LevelsAnswer, LinesAnswer
from app.api.schemas.analyses import AnalysisAnswer, AnalysisHead
from app.api.schemas.compensation import CompensationAnswer
from app.api.schemas.error_maps import ErrorMapAnswer
from app.api.schemas.grids import GridAnswer
from app.api.schemas.health import HealthAnswer, ReadyAnswer
from app.api.schemas.machines import MachineAnswer
from app.api.schemas.measurements.axes import PositioningAnswer
from app.api.schemas.measurements.base import MeasurementAnswer
from app.api.schemas.measurements.diagonals import BodyDiagonalAnswer, StepDiagonalAnswer
from app.api.schemas.measurements.parts import (
    DrilledPlateAnswer,
    MachinedPartAnswer,
    RotaryAxisAnswer,
)
from app.api.schemas.measurements.simulation import SimulatedStepDiagonal
from app.api.schemas.model_change import PreviewAnswer
from app.api.schemas.models import (
    AssignmentSchema,
    ChangedModelAnswer,
    CorrelationAnswer,
    ModelAnswer,
    ModelCoverageAnswer,
    WaitingAssignmentAnswer,
)
from app.api.schemas.needed import NeededAnswer, PresetAnswer
from app.api.schemas.predictions import PredictionAnswer
from app.api.schemas.readings import (
    ReadingSchema,
    StoredReadings,
    WithdrawnReadingAnswer,
    WithdrawnReadings,
)
from app.api.schemas.residuals import ModelComparisonAnswer, ResidualsAnswer
from app.api.schemas.rotary import RotaryErrorAnswer
from app.api.schemas.verifications import VerificationAnswer, WholeVerificationAnswer
from app.api.schemas.watch import WatchAnswer
from app.client import calls, loop_calls
from app.client.blocking import ThermapClient
from app.client.call import Answer, Call, Content
from app.client.calls import TaggedTable, VolumetricErrors
from app.client.connection import explaining, httpx_options, service_url, without_password
from app.identification.plan import Plan


class AsyncThermapClient:
    """A thermap service, one method a route, to be awaited.

    Parameters, exceptions and bodies are those of `ThermapClient`; a `transport`
    may be an `httpx.ASGITransport` around the application itself.
    """

    def __init__(
        self,
        base_url: str | None = None,
        *,
        timeout_s: float = 30.0,
        transport: httpx.AsyncBaseTransport | None = None,
    ) -> None:
        self._url = service_url(base_url)
        self._timeout_s = timeout_s
        self._http = httpx.AsyncClient(transport=transport, **httpx_options(self._url, timeout_s))

    @property
    def base_url(self) -> str:
        return without_password(self._url)

    async def health(self) -> HealthAnswer:
        return await self.send(calls.health())

    async def ready(self) -> ReadyAnswer:
        return await self.send(calls.ready())

    async def metrics(self) -> str:
        return await self.send(calls.metrics())

    async def create_machine(self, settings: Content) -> MachineAnswer:
        return await self.send(calls.create_machine(settings))

    async def machines(self) -> list[MachineAnswer]:
        return await self.send(calls.machines())

    async def machine(self, machine: str) -> MachineAnswer:
        return await self.send(calls.machine(machine))

    async def needed_components(
        self, machine: str, preset: str | None = None, tool_length_mm: float = 0.0
    ) -> NeededAnswer:
        return await self.send(calls.needed_components(machine, preset, tool_length_mm))

    async def nonrigid_presets(self) -> list[PresetAnswer]:
        return await self.send(calls.nonrigid_presets())

    async def change_machine(self, machine: str, changes: Content) -> MachineAnswer:
        return await self.send(calls.change_machine(machine, changes))

    async def delete_machine(self, machine: str) -> None:
        return await self.send(calls.delete_machine(machine))

    async def store_error_map(
        self, machine: str, error_map: Content, *, accept_losses: bool = False
    ) -> ErrorMapAnswer:
        return await self.send(calls.store_error_map(machine, error_map, accept_losses))

    async def preview_error_map(self, machine: str, error_map: Content) -> PreviewAnswer:
        return await self.send(calls.preview_error_map(machine, error_map))

    async def error_maps(self, machine: str) -> list[ErrorMapAnswer]:
        return await self.send(calls.error_maps(machine))

    async def error_map(self, machine: str, map_id: int) -> ErrorMapAnswer:
        return await self.send(calls.error_map(machine, map_id))

    async def delete_error_map(self, machine: str, map_id: int) -> None:
        return await self.send(calls.delete_error_map(machine, map_id))

    async def preview_map_deletion(self, machine: str, map_id: int) -> PreviewAnswer:
        return await self.send(calls.preview_map_deletion(machine, map_id))

    async def sensor_assignment(self, machine: str) -> dict[str, str]:
        return await self.send(calls.sensor_assignment(machine))

    async def assign_sensors(
        self,
        machine: str,
        assignment: AssignmentSchema | Mapping[str, str],
        *,
        accept_losses: bool = False,
    ) -> dict[str, str] | WaitingAssignmentAnswer:
        return await self.send(calls.assign_sensors(machine, assignment, accept_losses))

    async def preview_assignment(
        self, machine: str, assignment: AssignmentSchema | Mapping[str, str]
    ) -> PreviewAnswer:
        return await self.send(calls.preview_assignment(machine, assignment))

    async def correlate_sensors(self, machine: str) -> CorrelationAnswer:
        return await self.send(calls.correlate_sensors(machine))

    async def models(self, machine: str) -> list[ModelAnswer]:
        return await self.send(calls.models(machine))

    async def model(self, machine: str, version: int) -> ModelAnswer:
        return await self.send(calls.model(machine, version))

    async def model_coverage(self, machine: str, version: int) -> ModelCoverageAnswer:
        return await self.send(calls.model_coverage(machine, version))

    async def activate_model(self, machine: str, version: int) -> ChangedModelAnswer:
        return await self.send(calls.activate_model(machine, version))

    async def preview_activation(self, machine: str, version: int) -> PreviewAnswer:
        return await self.send(calls.preview_activation(machine, version))

    async def store_readings(
        self, machine: str, readings: Content | Iterable[Content]
    ) -> StoredReadings:
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
        return await self.send(calls.readings(machine, since, until, every_s, limit))

    async def withdrawn_readings(
        self,
        machine: str,
        since: datetime | str | None = None,
        until: datetime | str | None = None,
        limit: int | None = None,
    ) -> list[WithdrawnReadingAnswer]:
        return await self.send(calls.withdrawn_readings(machine, since, until, limit))

    async def withdraw_reading(self, machine: str, time: datetime | str) -> WithdrawnReadings:
        return await self.send(calls.withdraw_reading(machine, time))

    async def withdraw_readings(
        self, machine: str, since: datetime | str, until: datetime | str
    ) -> WithdrawnReadings:
        return await self.send(calls.withdraw_readings(machine, since, until))

    async def compensation(
        self,
        machine: str,
        temperatures_c: Mapping[str, float],
        state: Mapping[str, float] | None = None,
    ) -> CompensationAnswer:
        return await self.send(calls.compensation(machine, temperatures_c, state))

    async def current_table(self, machine: str, etag: str | None = None) -> TaggedTable | None:
        return await self.send(calls.current_table(machine, etag))

    async def predict(
        self,
        machine: str,
        observations: Sequence[Content],
        model_version: int | None = None,
        missing_components: str = "refuse",
    ) -> PredictionAnswer:
        return await self.send(
            calls.predict(machine, observations, model_version, missing_components)
        )

    async def volumetric_error(self, machine: str, question: Content) -> VolumetricErrors:
        return await self.send(calls.volumetric_error(machine, question))

    async def grid(self, machine: str, question: Content) -> GridAnswer:
        return await self.send(calls.grid(machine, question))

    async def volumetric_accuracy(self, machine: str, question: Content) -> AccuracyAnswer:
        return await self.send(calls.volumetric_accuracy(machine, question))

    async def accuracy_from_lines(self, lines: Content) -> LinesAnswer:
        return await self.send(calls.accuracy_from_lines(lines))

    async def compensation_levels(self, machine: str, question: Content) -> LevelsAnswer:
        return await self.send(calls.compensation_levels(machine, question))

    async def rotary_axis_error(self, machine: str, question: Content) -> RotaryErrorAnswer:
        return await self.send(calls.rotary_axis_error(machine, question))

    async def current_picture(self, machine: str, missing_components: str = "refuse") -> str:
        return await self.send(calls.current_picture(machine, missing_components))

    async def picture(self, machine: str, question: Content) -> dict[str, Any]:
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
        storing = calls.Storing(store, accept_losses, preview)
        return await self.send(calls.measure_step_diagonal(machine, measurement, storing))

    async def measure_body_diagonal(
        self,
        machine: str,
        measurement: Content,
        *,
        store: bool = False,
        accept_losses: bool = False,
        preview: bool = False,
    ) -> BodyDiagonalAnswer:
        storing = calls.Storing(store, accept_losses, preview)
        return await self.send(calls.measure_body_diagonal(machine, measurement, storing))

    async def measure_positioning(
        self,
        machine: str,
        measurement: Content,
        *,
        store: bool = False,
        accept_losses: bool = False,
        preview: bool = False,
    ) -> PositioningAnswer:
        storing = calls.Storing(store, accept_losses, preview)
        return await self.send(calls.measure_positioning(machine, measurement, storing))

    async def measure_six_dof(
        self,
        machine: str,
        measurement: Content,
        *,
        store: bool = False,
        accept_losses: bool = False,
        preview: bool = False,
    ) -> MeasurementAnswer:
        storing = calls.Storing(store, accept_losses, preview)
        return await self.send(calls.measure_six_dof(machine, measurement, storing))

    async def measure_machined_part(
        self,
        machine: str,
        measurement: Content,
        *,
        store: bool = False,
        accept_losses: bool = False,
        preview: bool = False,
    ) -> MachinedPartAnswer:
        storing = calls.Storing(store, accept_losses, preview)
        return await self.send(calls.measure_machined_part(machine, measurement, storing))

    async def measure_drilled_plate(
        self,
        machine: str,
        measurement: Content,
        *,
        store: bool = False,
        accept_losses: bool = False,
        preview: bool = False,
    ) -> DrilledPlateAnswer:
        storing = calls.Storing(store, accept_losses, preview)
        return await self.send(calls.measure_drilled_plate(machine, measurement, storing))

    async def measure_rotary_axis(
        self,
        machine: str,
        measurement: Content,
        *,
        store: bool = False,
        accept_losses: bool = False,
        preview: bool = False,
    ) -> RotaryAxisAnswer:
        storing = calls.Storing(store, accept_losses, preview)
        return await self.send(calls.measure_rotary_axis(machine, measurement, storing))

    async def simulate_step_diagonal(self, machine: str, plan: Content) -> SimulatedStepDiagonal:
        return await self.send(calls.simulate_step_diagonal(machine, plan))

    async def store_verification(self, machine: str, verification: Content) -> VerificationAnswer:
        return await self.send(loop_calls.store_verification(machine, verification))

    async def verifications(self, machine: str) -> list[VerificationAnswer]:
        return await self.send(loop_calls.verifications(machine))

    async def verification(self, machine: str, verification_id: int) -> WholeVerificationAnswer:
        return await self.send(loop_calls.verification(machine, verification_id))

    async def delete_verification(self, machine: str, verification_id: int) -> None:
        return await self.send(loop_calls.delete_verification(machine, verification_id))

    async def watch(self, machine: str) -> WatchAnswer:
        return await self.send(loop_calls.watch(machine))

    async def verification_residuals(
        self, machine: str, verification_id: int, model_version: int | None = None, rows: int = 0
    ) -> ResidualsAnswer:
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
        return await self.send(loop_calls.residuals(machine, verifications, model_version, rows))

    async def residuals_page(
        self, machine: str, verifications: Sequence[int], model_version: int | None = None
    ) -> str:
        return await self.send(loop_calls.residuals_page(machine, verifications, model_version))

    async def compare_models(
        self, machine: str, verifications: Sequence[int], versions: Sequence[int]
    ) -> ModelComparisonAnswer:
        return await self.send(loop_calls.compare_models(machine, verifications, versions))

    async def analyse(self, machine: str, question: Content) -> AnalysisHead:
        return await self.send(loop_calls.analyse(machine, question))

    async def plan_analysis(self, machine: str, plan: Content) -> Plan:
        return await self.send(loop_calls.plan_analysis(machine, plan))

    async def analyses(self, machine: str) -> list[AnalysisHead]:
        return await self.send(loop_calls.analyses(machine))

    async def analysis(self, machine: str, analysis_id: int) -> AnalysisAnswer:
        return await self.send(loop_calls.analysis(machine, analysis_id))

    async def analysis_report(self, machine: str, analysis_id: int) -> str:
        return await self.send(loop_calls.analysis_report(machine, analysis_id))

    async def cancel_analysis(self, machine: str, analysis_id: int) -> AnalysisHead:
        return await self.send(loop_calls.cancel_analysis(machine, analysis_id))

    async def delete_analysis(self, machine: str, analysis_id: int) -> None:
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
        return await self.send(
            loop_calls.preview_adoption(machine, analysis_id, effects, onto_active)
        )

    async def send(self, call: Call[Answer]) -> Answer:
        return call.answer(await self._exchange(call))

    async def content(self, call: Call[Any]) -> bytes:
        return call.checked(await self._exchange(call)).content

    async def aclose(self) -> None:
        """Give up the connections."""
        await self._http.aclose()

    async def __aenter__(self) -> Self:
        """Use the client in an `async with` block, which closes it."""
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close at the end of an `async with` block."""
        await self.aclose()

    async def _exchange(self, call: Call[Any]) -> httpx.Response:
        with explaining(self._url, call.waits_s(self._timeout_s)):
            return await self._http.request(**call.request(self._timeout_s))


for _name, _method in vars(AsyncThermapClient).items():
    if callable(_method) and not _name.startswith("_") and _method.__doc__ is None:
        _method.__doc__ = getdoc(getattr(ThermapClient, _name))
