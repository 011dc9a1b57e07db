"""The client: one method a route, as `thermap.calls` and `thermap.loop_calls` describe them.

Written by `scripts/write_client.py` from the awaiting one, which does not block.
"""

from __future__ import annotations

import time
from collections.abc import (
    Callable,
    Collection,
    Iterable,
    Iterator,
    Mapping,
)
from functools import wraps
from types import TracebackType
from typing import Any, Concatenate, ParamSpec, Self

import httpx

from thermap import calls, following, loop_calls
from thermap.answers import AnalysisAnswer, StoredReadings
from thermap.call import Answer, Call, Content, of_method
from thermap.connection import explaining, httpx_options, service_url, without_password
from thermap.errors import ServiceUnavailableError, error_of
from thermap.following import EventReader, Followed, Told

P = ParamSpec("P")


def _asks(
    call: Callable[P, Call[Answer]],
) -> Callable[Concatenate[ThermapClient, P], Answer]:
    """Make a method that sends what `call` describes, with its parameters and its docstring."""

    @wraps(call)
    def ask(client: ThermapClient, /, *args: P.args, **kwargs: P.kwargs) -> Answer:
        return client.send(call(*args, **kwargs))

    ask.__signature__ = of_method(call)  # type: ignore[attr-defined]
    return ask


class ThermapClient:
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
    Bodies are mappings with the fields of the shape that a method names, which the service's
    `/docs` shows; numpy arrays may stand wherever a list of numbers may. Safe to share by threads.
    """

    def __init__(
        self,
        base_url: str | None = None,
        *,
        key: str | None = None,
        timeout_s: float = 30.0,
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        self._url = service_url(base_url)
        self._timeout_s = timeout_s
        self._http = httpx.Client(transport=transport, **httpx_options(self._url, timeout_s, key))

    @property
    def base_url(self) -> str:
        """Where the service is, without a password."""
        return without_password(self._url)

    health = _asks(calls.health)
    ready = _asks(calls.ready)
    metrics = _asks(calls.metrics)
    keys = _asks(calls.keys)
    create_key = _asks(calls.create_key)
    revoke_key = _asks(calls.revoke_key)
    create_machine = _asks(calls.create_machine)
    machines = _asks(calls.machines)
    machine = _asks(calls.machine)
    statuses = _asks(calls.statuses)
    status = _asks(calls.status)
    needed_components = _asks(calls.needed_components)
    nonrigid_presets = _asks(calls.nonrigid_presets)
    change_machine = _asks(calls.change_machine)
    delete_machine = _asks(calls.delete_machine)
    store_error_map = _asks(calls.store_error_map)
    preview_error_map = _asks(calls.preview_error_map)
    import_file = _asks(calls.import_file)
    error_maps = _asks(calls.error_maps)
    error_map = _asks(calls.error_map)
    error_map_file = _asks(calls.error_map_file)
    file_template = _asks(calls.file_template)
    delete_error_map = _asks(calls.delete_error_map)
    preview_map_deletion = _asks(calls.preview_map_deletion)
    sensor_assignment = _asks(calls.sensor_assignment)
    assign_sensors = _asks(calls.assign_sensors)
    preview_assignment = _asks(calls.preview_assignment)
    correlate_sensors = _asks(calls.correlate_sensors)
    models = _asks(calls.models)
    model = _asks(calls.model)
    model_coverage = _asks(calls.model_coverage)
    activate_model = _asks(calls.activate_model)
    preview_activation = _asks(calls.preview_activation)

    def store_readings(self, machine: str, readings: Content | Iterable[Content]) -> StoredReadings:
        """Store one `ReadingSchema` or any number of them.

        They travel in parts of 10,000, each stored whole or not at all. After an
        error the same list may be sent again: what is there counts as duplicates.
        """
        parts = calls.store_readings(machine, readings)
        return calls.add_up([self.send(part) for part in parts])

    readings = _asks(calls.readings)
    history = _asks(calls.history)
    connections = _asks(calls.connections)
    receivers = _asks(calls.receivers)
    test_receiver = _asks(calls.test_receiver)
    events = _asks(calls.events)
    withdrawn_readings = _asks(calls.withdrawn_readings)
    withdraw_reading = _asks(calls.withdraw_reading)
    withdraw_readings = _asks(calls.withdraw_readings)
    compensation = _asks(calls.compensation)
    current_table = _asks(calls.current_table)
    predict = _asks(calls.predict)
    volumetric_error = _asks(calls.volumetric_error)
    grid = _asks(calls.grid)
    volumetric_accuracy = _asks(calls.volumetric_accuracy)
    accuracy_from_lines = _asks(calls.accuracy_from_lines)
    controllers = _asks(calls.controllers)
    export_compensation = _asks(calls.export_compensation)
    compare_compensation = _asks(calls.compare_compensation)
    parse_controller_files = _asks(calls.parse_controller_files)
    compensation_levels = _asks(calls.compensation_levels)
    rotary_axis_error = _asks(calls.rotary_axis_error)
    current_picture = _asks(calls.current_picture)
    picture = _asks(calls.picture)
    measure = _asks(calls.measure)
    simulate_step_diagonal = _asks(calls.simulate_step_diagonal)
    store_verification = _asks(loop_calls.store_verification)
    verifications = _asks(loop_calls.verifications)
    verification = _asks(loop_calls.verification)
    verification_file = _asks(loop_calls.verification_file)
    delete_verification = _asks(loop_calls.delete_verification)
    watch = _asks(loop_calls.watch)
    verification_residuals = _asks(loop_calls.verification_residuals)
    residuals = _asks(loop_calls.residuals)
    residuals_page = _asks(loop_calls.residuals_page)
    compare_models = _asks(loop_calls.compare_models)
    analyse = _asks(loop_calls.analyse)
    plan_analysis = _asks(loop_calls.plan_analysis)
    fleet = _asks(loop_calls.fleet)
    analyse_fleet = _asks(loop_calls.analyse_fleet)
    cancel_fleet = _asks(loop_calls.cancel_fleet)
    try_effect = _asks(loop_calls.try_effect)
    analyses = _asks(loop_calls.analyses)
    analysis = _asks(loop_calls.analysis)

    def wait_for_analysis(
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
        while waiting.goes_on(job := self.analysis(machine, analysis_id)):
            time.sleep(loop_calls.POLL_S)
        return job

    analysis_report = _asks(loop_calls.analysis_report)
    visits_page = _asks(loop_calls.visits_page)
    visit_file = _asks(loop_calls.visit_file)
    cancel_analysis = _asks(loop_calls.cancel_analysis)
    delete_analysis = _asks(loop_calls.delete_analysis)
    adopt_analysis = _asks(loop_calls.adopt_analysis)
    preview_adoption = _asks(loop_calls.preview_adoption)

    def follow(
        self,
        machine: str,
        *,
        min_change_um: float = 0.1,
        max_step_um: float | None = None,
        kinds: Collection[Followed] = following.TABLES,
    ) -> Iterator[Told]:
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
    ) -> Iterator[Told]:
        """Follow all machines, also those that are made later; as `follow` does one."""
        query = following.query_of(min_change_um, max_step_um, kinds)
        return self._follow("/v1/stream", query)

    def send(self, call: Call[Answer]) -> Answer:
        """Send a call that `thermap.calls` describes, and read its answer."""
        return call.answer(self._exchange(call))

    def content(self, call: Call[Any]) -> bytes:
        """Send a call and return its answer's bytes as they came."""
        return call.checked(self._exchange(call)).content

    def close(self) -> None:
        """Give up the connections."""
        self._http.close()

    def __enter__(self) -> Self:
        """Use the client in a `with` block, which closes it."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close at the end of a `with` block."""
        self.close()

    def _follow(self, path: str, query: Mapping[str, Any]) -> Iterator[Told]:
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
                    response = self._http.send(request, stream=True)
                    try:
                        if not response.is_success:
                            response.read()
                            raise error_of(response)
                        reader.begin()
                        for line in response.iter_lines():
                            event = reader.take(line)
                            if event is not None:
                                yield event
                    finally:
                        response.close()
                why = f"{self.base_url} ended the stream"
            except ServiceUnavailableError as error:
                if not reader.has_begun:
                    raise
                why = error.detail
            lost = reader.lost(why)
            if lost is not None:
                yield lost
            time.sleep(reader.pause_s())

    def _exchange(self, call: Call[Any]) -> httpx.Response:
        with explaining(self._url, call.waits_s(self._timeout_s)):
            return self._http.request(**call.request(self._timeout_s))
