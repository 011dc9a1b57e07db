"""Bring a machine from the database into memory: its model, its readings, and its effects' past."""

from __future__ import annotations

from datetime import timedelta

from sqlalchemy.orm import Session

from app.access.authorization import as_service
from app.effects.adopted.model_difference import ModelWithEffects
from app.effects.effect import Effect, effect_from_json
from app.errors import Conflict, UnknownThing
from app.live.reading_window import MOST_AHEAD, kept_spacing_s
from app.live.registry import Arrived, LiveMachine, LiveModel
from app.services.context import Context
from app.storage.machines import find_machine, stored_machine
from app.storage.model_versions import active_version
from app.storage.readings import readings_after, recent_readings
from app.storage.records import ModelVersion, StoredMachine
from app.storage.tables import MachineRow
from app.thermal.compile_model import compile_model
from app.thermal.compiled_model import CompiledModel
from app.thermal.machine import Machine
from app.thermal.reading import Reading
from app.thermal.sensor_health import record_needed_s


def load_machine(context: Context, machine_id: str) -> LiveMachine:
    """Load a machine into memory as the database has it, and return it.

    Raises
    ------
    StorageUnavailable
        If the database is away.
    """
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        live = live_model(context, session, row)
        withdrawals = row.withdrawals
    machine = context.live.publish(live)
    machine.expect(withdrawals)
    restore_past(context, machine)
    return machine


def live_model(context: Context, session: Session, row: MachineRow) -> LiveModel:
    """Read and compile a machine's active version inside a session."""
    stored = stored_machine(row)
    version = active_version(session, row)
    return as_live(context, stored, version, compile_version(stored.machine, version))


def as_live(
    context: Context, stored: StoredMachine, version: ModelVersion | None, model: CompiledModel
) -> LiveModel:
    """Set a compiled model beside the revision of the machine that it belongs to."""
    return LiveModel(
        model=model,
        version=None if version is None else version.version,
        created_at=stored.created_at,
        revision=stored.revision,
        loaded_at=context.now(),
        effects=adopted_effects(version),
    )


def adopted_effects(version: ModelVersion | None) -> tuple[Effect, ...]:
    """Read the effects that a version has adopted; InvalidContent if one cannot be read."""
    return tuple(effect_from_json(stored) for stored in (version.effects if version else ()))


def compile_version(machine: Machine, version: ModelVersion | None) -> CompiledModel:
    """Compile a version's maps with its assignment.

    Raises
    ------
    InvalidContent, Conflict
        As `compile_model`; also where the machine has lost a sensor of the assignment.
    """
    if version is None:
        return compile_model(machine, [], {})
    try:
        return compile_model(machine, [m.error_map for m in version.maps], version.assignment)
    except UnknownThing as unknown:
        raise Conflict(f"model version {version.version}: {unknown.detail}") from None


def effective_model(machine: Machine, version: ModelVersion | None) -> ModelWithEffects:
    """Compile a version with the effects that it has adopted, as `compile_version`."""
    return ModelWithEffects(compile_version(machine, version), adopted_effects(version))


@as_service()
def restore_past(context: Context, live: LiveMachine) -> None:
    """Restore a machine's readings, filters and states, where they are behind.

    Raises
    ------
    StorageUnavailable
        If the database is away; all stays as it was, and can be restored later.
    """
    if live.is_behind:
        _reread(context, live)
    past = live.past
    machine_id = live.current.model.machine.id

    def stored() -> list[Reading]:
        record = timedelta(seconds=past.record_s)
        with context.database.reading() as session:
            return recent_readings(session, machine_id, context.usable_until(), record, ())

    past.restore(stored)


def lacks_reading(context: Context, live: LiveMachine) -> bool:
    """Whether memory has no reading that can be used now, but the database may have."""
    live.advance_to(context.usable_until())
    return live.is_behind and live.readings.latest is None


def _reread(context: Context, live: LiveMachine) -> None:
    """Read the latest readings that can be used, and the first of those that lie ahead."""
    machine, until = live.current.model.machine, context.usable_until()
    sensors = machine.sensors.values()
    window = timedelta(seconds=record_needed_s(sensors) + kept_spacing_s(sensors))
    # Noted before the database is read: what is committed in between may be in both, and is taken
    # once; the other way round it would be in neither.
    with live.noting_arrivals() as meanwhile:
        with context.database.reading() as session:
            # First of all: what is withdrawn from now on counts as not yet withdrawn.
            withdrawals = find_machine(session, machine.id).withdrawals
            recent = recent_readings(session, machine.id, until, window, machine.sensors)
            ahead = readings_after(session, machine.id, until, MOST_AHEAD + 1)
        live.reread(Arrived([*recent, *ahead], withdrawals), meanwhile, until)
