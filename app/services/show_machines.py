"""Read machines, maps, models and readings as they are stored."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import closing
from dataclasses import replace
from datetime import datetime

from app.effects.adopted.model_difference import ModelWithEffects
from app.services.context import Context
from app.services.load_machine import adopted_effects, compile_version
from app.storage.error_maps import find_error_map, list_error_maps, stored_map
from app.storage.machines import find_machine, list_machines, stored_machine
from app.storage.model_versions import active_version, find_version, list_versions
from app.storage.readings import WithdrawnReading, list_readings, list_withdrawn
from app.storage.records import ModelVersion, StoredMachine, StoredMap
from app.storage.watches import watch_status, watch_statuses
from app.thermal.reading import Reading


def show_machines(context: Context) -> list[StoredMachine]:
    """List all machines."""
    with context.database.reading() as session:
        watched = watch_statuses(session)
        return [replace(m, watch=watched.get(m.machine.id)) for m in list_machines(session)]


def show_machine(context: Context, machine_id: str) -> StoredMachine:
    """Read one machine; UnknownThing if there is none."""
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        return replace(stored_machine(row), watch=watch_status(session, row))


def show_error_maps(context: Context, machine_id: str) -> tuple[list[StoredMap], set[int]]:
    """List a machine's maps, and the numbers of those in the active model."""
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        version = active_version(session, row)
        in_active_model = {m.id for m in version.maps} if version else set()
        return list_error_maps(session, machine_id), in_active_model


def show_error_map(context: Context, machine_id: str, map_id: int) -> tuple[StoredMap, bool]:
    """Read one map, and whether the active model contains it."""
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        found = stored_map(find_error_map(session, machine_id, map_id))
        version = active_version(session, row)
        return found, bool(version and any(m.id == map_id for m in version.maps))


def show_models(
    context: Context, machine_id: str
) -> tuple[list[ModelVersion], int | None, int | None]:
    """List a machine's model versions, and the numbers of the active and of the waiting one."""
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        return list_versions(session, machine_id), row.active_version, row.waiting_version


def show_model(
    context: Context, machine_id: str, version: int
) -> tuple[ModelVersion, int | None, int | None]:
    """Read one model version, and the numbers of the active and of the waiting one."""
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        found = find_version(session, machine_id, version)
        return found, row.active_version, row.waiting_version


def show_coverage(context: Context, machine_id: str, version: int) -> ModelWithEffects:
    """Compile a version, to see which components its tables have.

    Raises
    ------
    UnknownThing
        If there is no such version.
    InvalidContent, Conflict
        If the machine's present sensors no longer fit it.
    """
    with context.database.reading() as session:
        machine = stored_machine(find_machine(session, machine_id)).machine
        found = find_version(session, machine_id, version)
    return ModelWithEffects(compile_version(machine, found), adopted_effects(found))


def show_readings(
    context: Context,
    machine_id: str,
    since: datetime | None,
    until: datetime | None,
    every_s: float,
    limit: int,
) -> list[Reading]:
    """List readings in order of time, at most one for each `every_s` seconds."""
    with context.database.reading() as session:
        find_machine(session, machine_id)
        with closing(list_readings(session, machine_id, since, until)) as readings:
            return _spaced(readings, every_s, limit)


def show_withdrawn_readings(
    context: Context,
    machine_id: str,
    since: datetime | None,
    until: datetime | None,
    limit: int,
) -> list[WithdrawnReading]:
    """List the readings that were withdrawn, in order of time."""
    with context.database.reading() as session:
        find_machine(session, machine_id)
        return list_withdrawn(session, machine_id, since, until, limit)


def _spaced(readings: Iterable[Reading], every_s: float, limit: int) -> list[Reading]:
    kept: list[Reading] = []
    for reading in readings:
        if not kept or (reading.time - kept[-1].time).total_seconds() >= every_s:
            kept.append(reading)
        if len(kept) == limit:
            break
    return kept
