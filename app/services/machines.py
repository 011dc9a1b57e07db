"""Machines: create, show, change and delete them, and say whether all are in memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import asdict, dataclass, fields, replace
from datetime import datetime
from typing import Annotated, Any

from pydantic import Field
from sqlalchemy.exc import IntegrityError

from app.answer import Answer, fields_of, shown
from app.effects.past import sensors_of
from app.errors import Conflict, InvalidContent, StorageUnavailable, list_names
from app.events.event import EventKind
from app.geometry.components import COMPONENTS
from app.live.database_watch import TroubleKind
from app.live.registry import Arrived
from app.services.access_keys import unbind_keys
from app.services.change_model import MachineChange, changing_machine
from app.services.context import Context, repeated
from app.services.load_machine import adopted_effects, as_live, compile_version
from app.stated import Name, Schema
from app.storage.condition import free_bytes
from app.storage.error_maps import find_error_map, list_error_maps, stored_map
from app.storage.events import end_all_passing, write_event
from app.storage.limits import LONG, QUESTION
from app.storage.machines import (
    RowLock,
    count_machines,
    find_machine,
    insert_machine,
    list_machines,
    stored_machine,
    update_machine,
)
from app.storage.model_versions import active_version
from app.storage.news import NewsKind, tell
from app.storage.readings import WithdrawnReading, list_readings, list_withdrawn
from app.storage.records import ModelVersion, StoredMachine, StoredMap
from app.storage.watches import watch_status, watch_statuses
from app.thermal.machine import (
    EXAMPLE,
    MACHINE,
    ErrorRatio,
    Machine,
    Margin,
    OutOfRange,
    SameTemperature,
    StatedSensors,
    Travel,
)
from app.thermal.reading import Reading


@dataclass(frozen=True, kw_only=True)
class MachineAnswer(Machine, whole=False, example=EXAMPLE):
    """A machine as it is stored."""

    active_model: int | None
    """Active model version, null before the first map"""
    waiting_model: int | None = None
    """Version that has all that was stored and waits for its activation, because tables would lose
    something; null where none waits"""
    created_at: datetime
    """When it was created, UTC"""
    watch: str | None = None
    """What the last verifications say of the active model: `within` or `beyond` its limits
    (…/watch says more); null where none was judged"""


def machine_answer(stored: StoredMachine) -> MachineAnswer:
    """Show a stored machine."""
    return MachineAnswer(
        **fields_of(stored.machine),
        active_model=stored.active_version,
        waiting_model=stored.waiting_version,
        created_at=stored.created_at,
        watch=stored.watch,
    )


class MachinePatch(Schema, example={"out_of_range": "extrapolate"}):
    """The settings to change; lists are replaced whole, axes one by one (RFC 7396)."""

    name: Name | None = Field(None, description="Name for people")
    serial_number: Name | None = Field(None, description="Serial number; null removes it")
    configuration: str | None = Field(None, description="Kinematic chain", examples=["XYFZ"])
    axes: dict[str, Travel | None] | None = Field(
        None, description="Travels to change [mm]; null removes one"
    )
    sensors: StatedSensors | None = Field(None, description="All sensors, replacing the old")
    out_of_range: OutOfRange | None = Field(None, description="Policy outside the maps")
    extrapolation_margin_c: Margin | None = Field(
        None, description="How far `extrapolate` may go [°C]"
    )
    extrapolation_error_ratio: ErrorRatio | None = Field(
        None, description="How uncertain `extrapolate` may become, in times of the maps' own"
    )
    same_temperature: SameTemperature | None = Field(
        None, description="Policy for maps at one temperature"
    )

    def apply(self, machine: Machine) -> Machine:
        """Merge into a machine's present settings; InvalidContent where null makes no sense."""
        present = MACHINE.dump_python(machine)
        for field in self.model_fields_set:
            value = getattr(self, field)
            if value is None and field != "serial_number":
                raise InvalidContent.of_field(field, "expected a value, got null")
            if field == "axes":
                merged = {**present["axes"], **{a.lower(): t for a, t in value.items()}}
                value = {axis: travel for axis, travel in merged.items() if travel is not None}
            present[field] = value
        return MACHINE.validate_python(present)


@repeated
def create_machine(context: Context, machine: Machine) -> tuple[StoredMachine, bool]:
    """Store a machine, and say whether it is new: the same again is the one that is there.

    Raises
    ------
    Conflict
        If there is a machine of that id with other settings.
    """
    try:
        with context.database.writing() as session:
            stored = insert_machine(session, machine, context.now())
            unbind_keys(session, machine.id, context.now())
            write_event(session, machine.id, EventKind.MACHINE, "machine created", context.now())
    except IntegrityError:
        present = show_machine(context, machine.id)
        if present.machine == machine:
            return present, False
        raise Conflict(
            f"there is a machine {machine.id!r} with other settings; change it by `thermap "
            f"machines set {machine.id} KEY=VALUE`, or choose another id"
        ) from None
    live = context.live.publish(as_live(context, stored, None, compile_version(machine, None)))
    live.reread(Arrived((), 0), (), context.usable_until())
    return stored, True


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
        error_map = stored_map(find_error_map(session, machine_id, map_id))
        version = active_version(session, row)
        return error_map, bool(version and any(m.id == map_id for m in version.maps))


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
    spaced: list[Reading] = []
    for reading in readings:
        if not spaced or (reading.time - spaced[-1].time).total_seconds() >= every_s:
            spaced.append(reading)
        if len(spaced) == limit:
            break
    return spaced


@repeated
def change_machine(
    context: Context, machine_id: str, edit: Callable[[Machine], Machine]
) -> StoredMachine:
    """Apply an edit to a machine as it is at that moment.

    Parameters
    ----------
    edit
        Makes the new description from the present one, under the machine's lock.

    Raises
    ------
    Conflict
        If a sensor or an axis goes that maps or the assignment use, maps
        become too close for a sensor's new resolution, or a new travel is evidently
        in another unit than the positions of stored maps, or has none of them.
    """
    with changing_machine(context, machine_id) as change:
        before = change.machine
        after = edit(before)
        maps = list_error_maps(change.session, machine_id)
        _check_sensors_stay(before, after, maps, [change.version, change.waiting])
        _check_axes_stay(after, maps)
        _check_travels_fit(before, after, maps)
        update_machine(change.row, after)
        _note_change(context, change, before, after)
        watched = watch_status(change.session, change.row)
    return replace(stored_machine(change.row), watch=watched)


def _note_change(context: Context, change: MachineChange, before: Machine, after: Machine) -> None:
    changes = list(_changes(_settings(before), _settings(after)))
    if changes:
        words = f"settings changed: {'; '.join(changes)}"
        write_event(change.session, after.id, EventKind.MACHINE, words, context.now())


def _settings(machine: Machine) -> dict[str, Any]:
    """Give a machine's settings by name."""
    plain = {f.name: getattr(machine, f.name) for f in fields(machine) if f.name != "chain"}
    return {
        **plain,
        "configuration": machine.chain.text,
        "axes": {name: asdict(travel) for name, travel in machine.axes.items()},
        "sensors": {name: asdict(sensor) for name, sensor in machine.sensors.items()},
    }


def _changes(old: Any, new: Any, name: str = "") -> Iterator[str]:
    """Say which settings differ, each with its old and its new value."""
    if old == new:
        return
    if isinstance(old, dict) and isinstance(new, dict):
        for key in {**old, **new}:
            yield from _changes(old.get(key), new.get(key), f"{name} {key}".lstrip())
    elif isinstance(new, dict):
        yield f"{name} added"
    elif isinstance(old, dict):
        yield f"{name} removed"
    else:
        yield f"{name} from {_setting(old)} to {_setting(new)}"


def _setting(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    return "none" if value is None else repr(str(value))


def _check_sensors_stay(
    before: Machine,
    after: Machine,
    maps: list[StoredMap],
    versions: Iterable[ModelVersion | None],
) -> None:
    gone = set(before.sensors) - set(after.sensors)
    in_maps = {name for m in maps for name in m.error_map.temperatures_c}
    used = set(in_maps)
    for version in versions:
        used |= set(version.assignment.values()) if version else set()
        used |= sensors_of(adopted_effects(version))
    still_used = sorted(gone & used)
    if still_used:
        raise Conflict(
            f"sensors {list_names(still_used)} can neither go nor be renamed: error maps, the "
            "sensor assignment or adopted effects use their names"
        )


def _check_axes_stay(after: Machine, maps: list[StoredMap]) -> None:
    moved = {COMPONENTS[code].axis for m in maps for code in m.error_map.tables}
    missing = sorted(axis for axis in moved if axis and axis not in after.chain.axes)
    if missing:
        raise Conflict(
            f"configuration {after.chain.text} lacks axes {list_names(missing)} of stored maps"
        )


def _check_travels_fit(before: Machine, after: Machine, maps: list[StoredMap]) -> None:
    """Refuse a travel beside which positions of stored maps are in another unit, or all beyond."""
    changed = {a: t for a, t in after.axes.items() if before.axes.get(a) != t}
    for stored in maps:
        for code, table in stored.error_map.tables.items():
            travel = changed.get(table.component.axis or "")
            if travel is None:
                continue
            are_beyond = bool(travel.beyond(table.positions_mm).all())
            if not are_beyond and travel.unit_meant(table.positions_mm.tolist()) is None:
                continue
            first, last = table.positions_mm[0], table.positions_mm[-1]
            raise Conflict(
                f"expected a travel of {table.component.axis} in mm that fits the stored maps, "
                f"got {travel.min_mm:g} to {travel.max_mm:g} mm, where map "
                f"{stored.error_map.label!r} has {code} from {first:g} to {last:g} mm"
            )


@repeated
def delete_machine(context: Context, machine_id: str) -> None:
    """Delete everything about a machine."""
    with context.database.writing(LONG) as session:
        session.delete(find_machine(session, machine_id, RowLock.DELETED))
        tell(session, NewsKind.MACHINE, machine_id)
        end_all_passing(session, machine_id, context.now())
        unbind_keys(session, machine_id, context.now())
        write_event(session, machine_id, EventKind.MACHINE, "machine deleted", context.now())
    context.live.forget(machine_id)


@dataclass(frozen=True, slots=True)
class Readiness(Answer, published_as="ReadyAnswer", whole=False):
    """Whether the database is there and the models are in memory."""

    database: str
    """`ok`, or what is the matter"""
    machines: int
    """Machines in the database"""
    machines_in_memory: int
    """Machines whose model is in memory"""
    disk_free_bytes: int | None = None
    """Free on the disk of the database's file [bytes]; null where that is not known, as on
    PostgreSQL"""

    @shown
    def status(self) -> Annotated[str, Field(examples=["ready"])]:
        """`ready` or `not-ready`."""
        return "ready" if self.is_ready else "not-ready"

    @property
    def is_ready(self) -> bool:
        """Whether the database is there and every model is in memory."""
        return self.database == "ok" and self.machines_in_memory >= self.machines


def check_readiness(context: Context) -> Readiness:
    """Ask the database; a failure is part of the answer."""
    in_memory = len(context.live)
    free = free_bytes(context.database)
    try:
        with context.database.reading(QUESTION) as session:
            machines = count_machines(session)
    except StorageUnavailable as error:
        return Readiness(error.detail, in_memory, in_memory, free)
    trouble = context.live.database.trouble
    if trouble is not None and trouble.matter is TroubleKind.LOCKED:
        locked = "the database is locked: nothing can be stored"
        return Readiness(locked, machines, in_memory, free)
    return Readiness("ok", machines, in_memory, free)


def without_answer(context: Context) -> Readiness:
    """Say that the database does not answer."""
    in_memory = len(context.live)
    return Readiness("the database does not answer", in_memory, in_memory)
