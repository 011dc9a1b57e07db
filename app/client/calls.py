"""Every route described once: what is sent, and how its answer is read.

Both clients send these; neither knows a path or a body.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from itertools import islice
from typing import Any, Final
from urllib.parse import quote

import httpx
from pydantic import BaseModel

from app.api.routes.health import HealthAnswer, ReadyAnswer
from app.api.schemas.compensation import CompensationAnswer, CurrentCompensationAnswer
from app.api.schemas.error_maps import ErrorMapAnswer
from app.api.schemas.machines import MachineAnswer
from app.api.schemas.models import AssignmentSchema, CorrelationAnswer, ModelAnswer
from app.api.schemas.predictions import PredictionAnswer
from app.api.schemas.readings import ReadingSchema, StoredReadings
from app.client.call import Call, Content, nothing, reader_of
from app.client.errors import error_of

READINGS_A_CALL: Final = 10_000
"""As many as the service takes in one request."""


@dataclass(frozen=True, slots=True)
class TaggedTable:
    """The current compensation table, and the ETag to ask with for a change of it."""

    table: CurrentCompensationAnswer
    etag: str


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


# -- machines ------------------------------------------------------------------------------


def create_machine(settings: Content) -> Call[MachineAnswer]:
    """POST /v1/machines."""
    return Call("POST", "/v1/machines", reader_of(MachineAnswer), settings)


def machines() -> Call[list[MachineAnswer]]:
    """GET /v1/machines."""
    return Call("GET", "/v1/machines", reader_of(list[MachineAnswer]))


def machine(machine_id: str) -> Call[MachineAnswer]:
    """GET /v1/machines/{machine}."""
    return Call("GET", _of(machine_id), reader_of(MachineAnswer))


def change_machine(machine_id: str, changes: Content) -> Call[MachineAnswer]:
    """PATCH /v1/machines/{machine}."""
    return Call("PATCH", _of(machine_id), reader_of(MachineAnswer), changes)


def delete_machine(machine_id: str) -> Call[None]:
    """DELETE /v1/machines/{machine}."""
    return Call("DELETE", _of(machine_id), nothing)


# -- error maps ----------------------------------------------------------------------------


def store_error_map(machine_id: str, error_map: Content) -> Call[ErrorMapAnswer]:
    """POST …/error-maps."""
    return Call("POST", _of(machine_id, "error-maps"), reader_of(ErrorMapAnswer), error_map)


def error_maps(machine_id: str) -> Call[list[ErrorMapAnswer]]:
    """GET …/error-maps."""
    return Call("GET", _of(machine_id, "error-maps"), reader_of(list[ErrorMapAnswer]))


def error_map(machine_id: str, map_id: int) -> Call[ErrorMapAnswer]:
    """GET …/error-maps/{id}."""
    return Call("GET", _of(machine_id, "error-maps", map_id), reader_of(ErrorMapAnswer))


def delete_error_map(machine_id: str, map_id: int) -> Call[None]:
    """DELETE …/error-maps/{id}."""
    return Call("DELETE", _of(machine_id, "error-maps", map_id), nothing)


# -- sensor assignment and models ----------------------------------------------------------


def sensor_assignment(machine_id: str) -> Call[dict[str, str]]:
    """GET …/sensor-assignment."""
    return Call("GET", _of(machine_id, "sensor-assignment"), reader_of(dict[str, str]))


def assign_sensors(
    machine_id: str, assignment: AssignmentSchema | Mapping[str, str]
) -> Call[dict[str, str]]:
    """PUT …/sensor-assignment."""
    return Call("PUT", _of(machine_id, "sensor-assignment"), reader_of(dict[str, str]), assignment)


def correlate_sensors(machine_id: str) -> Call[CorrelationAnswer]:
    """POST …/sensor-assignment/correlate."""
    path = _of(machine_id, "sensor-assignment", "correlate")
    return Call("POST", path, reader_of(CorrelationAnswer))


def models(machine_id: str) -> Call[list[ModelAnswer]]:
    """GET …/models."""
    return Call("GET", _of(machine_id, "models"), reader_of(list[ModelAnswer]))


def model(machine_id: str, version: int) -> Call[ModelAnswer]:
    """GET …/models/{version}."""
    return Call("GET", _of(machine_id, "models", version), reader_of(ModelAnswer))


def activate_model(machine_id: str, version: int) -> Call[ModelAnswer]:
    """POST …/models/{version}/activate."""
    return Call("POST", _of(machine_id, "models", version, "activate"), reader_of(ModelAnswer))


# -- live ----------------------------------------------------------------------------------


def store_readings(
    machine_id: str, readings: Content | Iterable[Content]
) -> Iterator[Call[StoredReadings]]:
    """POST …/readings, as often as their number needs."""
    path = _of(machine_id, "readings")
    remaining = iter([readings] if isinstance(readings, BaseModel | Mapping) else readings)
    while part := list(islice(remaining, READINGS_A_CALL)):
        yield Call("POST", path, reader_of(StoredReadings), part)


def add_up(parts: Iterable[StoredReadings]) -> StoredReadings:
    """Add what became of each part of a long list of readings.

    >>> add_up([StoredReadings(stored=2, duplicates=1), StoredReadings(stored=1, duplicates=0)])
    StoredReadings(stored=3, duplicates=1)
    """
    found = list(parts)
    return StoredReadings(
        stored=sum(part.stored for part in found), duplicates=sum(part.duplicates for part in found)
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
    return Call("GET", _of(machine_id, "readings"), reader_of(list[ReadingSchema]), query=query)


def compensation(
    machine_id: str, temperatures_c: Mapping[str, float], state: Mapping[str, float] | None
) -> Call[CompensationAnswer]:
    """POST …/compensation."""
    body = {"temperatures_c": temperatures_c, "state": state or {}}
    return Call("POST", _of(machine_id, "compensation"), reader_of(CompensationAnswer), body)


def current_table(machine_id: str, etag: str | None) -> Call[TaggedTable | None]:
    """GET …/compensation; 304 is the answer None."""
    return Call(
        "GET",
        _of(machine_id, "compensation"),
        _read_tagged,
        headers={"If-None-Match": etag} if etag else {},
        answered_by=frozenset({304}),
    )


def predict(
    machine_id: str, observations: Iterable[Content], model_version: int | None
) -> Call[PredictionAnswer]:
    """POST …/predictions."""
    body: dict[str, Any] = {"observations": list(observations)}
    if model_version is not None:
        body["model_version"] = model_version
    return Call("POST", _of(machine_id, "predictions"), reader_of(PredictionAnswer), body)


def _of(machine_id: str, *further: str | int) -> str:
    """Name a path below a machine, whatever characters its id has.

    >>> _of("mill 3/b", "models", 2)
    '/v1/machines/mill%203%2Fb/models/2'
    """
    if not machine_id:
        raise ValueError("expected a machine's id, came an empty one")
    return "/".join(["/v1/machines", quote(machine_id, safe=""), *map(str, further)])


def _read_ready(response: httpx.Response) -> ReadyAnswer:
    if response.headers.get("content-type", "") != "application/json":
        raise error_of(response)
    return reader_of(ReadyAnswer)(response)


def _read_tagged(response: httpx.Response) -> TaggedTable | None:
    if response.status_code == httpx.codes.NOT_MODIFIED:
        return None
    table = reader_of(CurrentCompensationAnswer)(response)
    return TaggedTable(table, response.headers.get("etag", ""))
