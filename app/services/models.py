"""Model versions: preview and activate them, and say which sensor each component follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Annotated, Literal

from pydantic import Field, InstanceOf

from app.answer import Answer, shown
from app.compensation.table import CompensationTable
from app.compensation.table_difference import ComponentChange, component_changes
from app.effects.adopted.model_difference import ModelWithEffects, Part
from app.effects.effect import Effect
from app.errors import FieldError, InvalidContent, ThermapError, UnknownThing
from app.live.registry import LiveMachine, LiveModel
from app.services.change_model import (
    Draft,
    MachineChange,
    MadeVersion,
    WaitedBefore,
    activate_waiting,
    changing_machine,
    difference_to_active,
    draft_version,
    made_version,
    make_version,
    note_version,
    reading_machine,
    waited_before,
)
from app.services.context import Context, repeated
from app.services.live_table import CurrentTable, current_state, current_table
from app.services.load_machine import adopted_effects, compile_version, load_machine, restore_past
from app.services.recorded_change import RecordedChanges, recorded_changes
from app.storage.machines import find_machine, stored_machine
from app.storage.model_versions import activate_version, active_version, find_version, set_waiting
from app.storage.records import ModelVersion
from app.thermal.compiled_model import CompiledModel
from app.thermal.machine import Machine
from app.thermal.sensor_assignment import Proposal, propose_assignment, with_patterns


@dataclass(frozen=True, slots=True, eq=False)
class PresentChange:
    """By how much tables would change at the latest reading.

    `why_not` says why that is not known; the others are empty then. `before` and `after` are the
    two tables.
    """

    why_not: str = ""
    reading_time: datetime | None = None
    temperatures_c: Mapping[str, float] = field(default_factory=dict)
    changes: Sequence[ComponentChange] = ()
    before: CompensationTable | None = None
    after: CompensationTable | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Preview(Answer, published_as="PreviewAnswer", whole=False):
    """What a change would do to the tables; nothing is stored."""

    preview: Literal[True] = True
    """That nothing is stored"""
    reason: Annotated[str, Field(examples=["map 'Run #7' stored"])]
    """What would make the version, and which effects it would not keep"""
    active_version: Annotated[int | None, Field(examples=[3])] = None
    """The version that it is compared with; null before the first"""
    activated: bool
    """Whether it would be activated without more ado"""
    loses: Sequence[Part]
    """What its tables lack against those of the version active before"""
    gains: Sequence[Part]
    """What its tables have beyond those"""
    waited_before: WaitedBefore | None = None
    """What waited already; null where nothing did"""
    reading_time: datetime | None = None
    """Time of the latest reading, at which `changes` hold; null without, UTC"""
    temperatures_c: Mapping[str, float]
    """Its temperatures [°C]"""
    changes: Sequence[ComponentChange]
    """By how much each component that stays would change then, largest number first (1 µrad counts
    as 1 µm)"""
    not_compared: str
    """Why nothing is known of changes, such as that there is no reading; else empty"""
    recorded: RecordedChanges
    """The same at what was recorded before: a map whose temperatures are wrong may change nothing
    at the latest reading"""
    warnings: Sequence[str] = ()
    """What is unusual about what would be stored, such as numbers that may be in another unit"""
    is_there: Annotated[bool, Field(exclude=True)] = False
    """Whether what would be stored is stored already, so that nothing would change"""
    before: Annotated[InstanceOf[CompensationTable] | None, Field(exclude=True)] = None
    after: Annotated[InstanceOf[CompensationTable] | None, Field(exclude=True)] = None


def preview_draft(
    context: Context, change: MachineChange, draft: Draft, *, activates: bool = False
) -> Preview:
    """Say what a version that is not written yet would do.

    It is activated if it loses nothing, with `activates` whatever it loses.
    """
    return _preview(context, change, draft.reason, draft.model, draft.effects, activates=activates)


def preview_latest(context: Context, change: MachineChange, reason: str) -> Preview:
    """Say what becomes of what is stored already: nothing new, but something may wait."""
    latest = change.latest
    model, effects = compile_version(change.machine, latest), adopted_effects(latest)
    return _preview(context, change, reason, model, effects)


def preview_unchanged(context: Context, change: MachineChange, reason: str) -> Preview:
    """Say that tables stay as they are."""
    active = change.version
    model, effects = compile_version(change.machine, active), adopted_effects(active)
    return _preview(context, change, reason, model, effects)


def preview_activation(context: Context, change: MachineChange, version: ModelVersion) -> Preview:
    """Say what activating a version would do: it is active whatever it loses."""
    model, effects = compile_version(change.machine, version), adopted_effects(version)
    reason = f"version {version.version} activated"
    return _preview(context, change, reason, model, effects, activates=True)


def _preview(
    context: Context,
    change: MachineChange,
    reason: str,
    model: CompiledModel,
    effects: Sequence[Effect],
    *,
    activates: bool = False,
) -> Preview:
    difference = difference_to_active(context, change, ModelWithEffects(model, effects))
    present = _present_change(context, change, model, effects)
    return Preview(
        reason=reason,
        active_version=change.row.active_version,
        activated=activates or not difference.loses,
        loses=difference.loses,
        gains=difference.gains,
        waited_before=waited_before(context, change, difference.loses),
        reading_time=present.reading_time,
        temperatures_c=present.temperatures_c,
        changes=present.changes,
        not_compared=present.why_not,
        recorded=_recorded_changes(context, change, model, effects, present.changes),
        before=present.before,
        after=present.after,
    )


def _recorded_changes(
    context: Context,
    change: MachineChange,
    model: CompiledModel,
    effects: Sequence[Effect],
    now: Sequence[ComponentChange],
) -> RecordedChanges:
    """Compare the active model's tables with another's at what was recorded."""
    if change.version is None:
        return RecordedChanges(0, ())
    live = _live_machine(context, change)
    after = _with_other(live.current, model, effects)
    until = context.usable_until()
    return recorded_changes(change.session, live.current, after, until, now)


def _live_machine(context: Context, change: MachineChange) -> LiveMachine:
    """Give the machine in memory, with the version that is active in the database."""
    live = context.live.get(change.row.id)
    if live is None or live.current.version != change.row.active_version:
        live = load_machine(context, change.row.id)
    return live


def _present_change(
    context: Context, change: MachineChange, model: CompiledModel, effects: Sequence[Effect]
) -> PresentChange:
    """Compute the table at the latest reading with the active model, and with another."""
    if change.row.active_version is None:
        return PresentChange("there is no active model yet")
    live = _live_machine(context, change)
    other = _with_model(context, live, model, effects)
    tables = []
    for whose, machine in (("", live), ("with the new version ", other)):
        try:
            state = current_state(context, change.row.id, machine)
            tables.append(current_table(context, state))
        except ThermapError as error:
            return PresentChange(f"{whose}there is no table now: {error.detail}")
    return _changes_between(*tables)


def _changes_between(before: CurrentTable, after: CurrentTable) -> PresentChange:
    return PresentChange(
        reading_time=before.state.reading.time,
        temperatures_c=_used_temperatures(before),
        changes=component_changes(before.table, after.table),
        before=before.table,
        after=after.table,
    )


def compare_now(context: Context, machine_id: str, first: int, other: int) -> PresentChange:
    """Say by how much tables with two versions differ at the latest reading."""
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        machine = stored_machine(row).machine
        versions = [find_version(session, machine_id, number) for number in (first, other)]
    live = context.live.get(machine_id) or load_machine(context, machine_id)
    tables = []
    for version in versions:
        try:
            model, effects = compile_version(machine, version), adopted_effects(version)
            state = current_state(context, machine_id, _with_model(context, live, model, effects))
            tables.append(current_table(context, state))
        except ThermapError as error:
            return PresentChange(f"with v{version.version} there is no table now: {error.detail}")
    return _changes_between(*tables)


def _used_temperatures(current: CurrentTable) -> dict[str, float]:
    sensors = current.state.sensors
    return {s.sensor: s.temperature_c for s in sensors if s.temperature_c is not None}


def _with_model(
    context: Context, live: LiveMachine, model: CompiledModel, effects: Sequence[Effect]
) -> LiveMachine:
    """Set another model beside a machine's readings, with the past that its effects need."""
    other = LiveMachine(_with_other(live.current, model, effects))
    window = live.readings.held
    # A window of its own: what becomes usable meanwhile is the live machine's to take in.
    other.readings.replace(model.machine, [*window.used, *window.ahead], context.usable_until())
    other.is_behind = False
    if live.past.serves(model.machine, other.current.needed):
        other.past = live.past
    else:
        restore_past(context, other)
    return other


def _with_other(now: LiveModel, model: CompiledModel, effects: Sequence[Effect]) -> LiveModel:
    return LiveModel(
        model, now.version, now.created_at, now.revision, now.loaded_at, tuple(effects)
    )


@repeated
def activate_model(context: Context, machine_id: str, version: int) -> MadeVersion:
    """Activate a version, whatever its tables lose: the answer says what.

    Another version that waited waits no more, for the next one is made of the active one.

    Raises
    ------
    InvalidContent, Conflict
        If the machine's present sensors no longer fit it.
    """
    with changing_machine(context, machine_id) as change:
        version_to_activate = find_version(change.session, machine_id, version)
        model = compile_version(change.machine, version_to_activate)
        after = ModelWithEffects(model, adopted_effects(version_to_activate))
        difference = difference_to_active(context, change, after)
        was_active = change.row.active_version
        if was_active != version:
            activate_version(change.row, version)
            note_version(context, change, version_to_activate, was_active, is_active=True)
        set_waiting(change.row, None)
        return made_version(change, version_to_activate, difference)


def preview_model_activation(context: Context, machine_id: str, version: int) -> Preview:
    """Say what activating a version would do, and leave everything as it is.

    Raises
    ------
    UnknownThing, InvalidContent, Conflict
        As `activate_model`.
    """
    with reading_machine(context, machine_id) as change:
        version_to_activate = find_version(change.session, machine_id, version)
        return preview_activation(context, change, version_to_activate)


@dataclass(frozen=True, slots=True, eq=False)
class Assigned:
    """The whole assignment as it was stated, and the version that says so.

    `made` is None where the active version says so already.
    """

    assignment: Mapping[str, str]
    made: MadeVersion | None


@repeated
def assign_sensors(
    context: Context,
    machine_id: str,
    assignment: Mapping[str, str],
    *,
    accept_losses: bool = False,
) -> Assigned:
    """Assign sensors to components (codes); the others keep theirs.

    Parameters
    ----------
    assignment
        Component code, or a pattern of the maps' codes such as `E*X`, to sensor.

    Raises
    ------
    InvalidContent
        If a sensor is unknown, or a map lacks a sensor's temperature.
    Conflict
        If maps are too close at a sensor.
    """
    with changing_machine(context, machine_id) as change:
        draft = _draft(change, assignment)
        if draft is not None:
            new_version = make_version(context, change, draft, accept_losses=accept_losses)
            return Assigned(new_version.version.assignment, new_version)
        waiting = activate_waiting(context, change, accept_losses=accept_losses)
        version = change.latest
        return Assigned(version.assignment if version else {}, waiting)


def preview_assignment(context: Context, machine_id: str, assignment: Mapping[str, str]) -> Preview:
    """Say what an assignment would do to the tables, and change nothing.

    Raises
    ------
    UnknownThing, InvalidContent, Conflict
        As `assign_sensors`.
    """
    with reading_machine(context, machine_id) as change:
        draft = _draft(change, assignment)
        if draft is None:
            return preview_latest(context, change, "it is assigned so already")
        return preview_draft(context, change, draft)


def _draft(change: MachineChange, assignment: Mapping[str, str]) -> Draft | None:
    """Put the version together that has the assignment; None where there is one already."""
    _check_sensors(change.machine, assignment)
    base = change.latest
    present = {code for m in (base.maps if base else ()) for code in m.error_map.tables}
    assignment = with_patterns(assignment, present)
    assignment_before = dict(base.assignment) if base else {}
    if assignment_before | dict(assignment) == assignment_before:
        return None
    named = ", ".join(f"{code} to {sensor}" for code, sensor in assignment.items())
    maps = base.maps if base else []
    return draft_version(change, base, maps, f"assigned {named}"[:500], assignment)


def sensor_assignment(context: Context, machine_id: str) -> Mapping[str, str]:
    """Read the active version's assignment."""
    _, version = _machine_and_version(context, machine_id)
    return version.assignment if version else {}


@dataclass(frozen=True, slots=True)
class Correlated(Answer, published_as="CorrelationAnswer"):
    """The proposal; nothing has changed."""

    components: Sequence[Proposal]
    """One for each component of the maps"""

    @shown
    def proposal(self) -> dict[str, str]:
        """The assignment that the maps speak for, ready to be PUT."""
        return {
            entry.code: entry.proposed_sensor
            for entry in self.components
            if entry.proposed_sensor is not None
        }


def correlate_sensors(context: Context, machine_id: str) -> Correlated:
    """Correlate the active version's maps with every sensor; nothing changes."""
    machine, version = _machine_and_version(context, machine_id)
    if version is None:
        return Correlated(())
    error_maps = [stored.error_map for stored in version.maps]
    return Correlated(propose_assignment(machine, error_maps, version.assignment))


def _machine_and_version(context: Context, machine_id: str) -> tuple[Machine, ModelVersion | None]:
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        return stored_machine(row).machine, active_version(session, row)


def _check_sensors(machine: Machine, assignment: Mapping[str, str]) -> None:
    errors = []
    for code, name in assignment.items():
        try:
            machine.sensor(name)
        except UnknownThing as unknown:
            errors.append(FieldError(code, unknown.detail))
    if errors:
        raise InvalidContent("; ".join(e.message for e in errors), errors)
