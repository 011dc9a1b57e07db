"""Model versions: preview and activate them, and say which sensor each component follows."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import BeforeValidator, Field, InstanceOf

from app.answer import Answer, fields_of, shown
from app.compensation.table import CompensationTable
from app.compensation.table_difference import ComponentChange, component_changes
from app.effects.adopted.described import AdoptedEffect, adopted_effect
from app.effects.adopted.model_difference import ModelWithEffects, Part
from app.errors import FieldError, InvalidContent, ThermapError, UnknownComponent, UnknownThing
from app.geometry.components import ORDER, parse_component
from app.live.registry import LiveMachine, LiveModel
from app.services.change_model import (
    Draft,
    MachineChange,
    MadeVersion,
    ModelChange,
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
from app.services.load_machine import adopted_effects, effective_model, load_machine, restore_past
from app.services.recorded_change import RecordedChanges, recorded_changes
from app.stated import made
from app.storage.machines import find_machine, stored_machine
from app.storage.model_versions import (
    activate_version,
    active_version,
    find_version,
    list_versions,
    set_waiting,
)
from app.storage.records import ModelVersion
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


def preview(
    context: Context,
    change: MachineChange,
    reason: str,
    after: ModelWithEffects,
    *,
    activates: bool = False,
) -> Preview:
    """Say what a model would do that is not active yet.

    It is activated if it loses nothing, with `activates` whatever it loses.
    """
    difference = difference_to_active(context, change, after)
    present = _present_change(context, change, after)
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
        recorded=_recorded_changes(context, change, after, present.changes),
        before=present.before,
        after=present.after,
    )


def preview_draft(
    context: Context, change: MachineChange, draft: Draft, *, activates: bool = False
) -> Preview:
    """Say the same of a version that is not written yet."""
    return preview(context, change, draft.reason, draft.effective, activates=activates)


def preview_stored(
    context: Context, change: MachineChange, reason: str, version: ModelVersion | None
) -> Preview:
    """Say what becomes of what is stored already: nothing new, but something may wait."""
    return preview(context, change, reason, effective_model(change.machine, version))


def _recorded_changes(
    context: Context,
    change: MachineChange,
    other: ModelWithEffects,
    now: Sequence[ComponentChange],
) -> RecordedChanges:
    """Compare the active model's tables with another's at what was recorded."""
    if change.version is None:
        return RecordedChanges(0, ())
    live = _live_machine(context, change)
    after = _with_other(live.current, other)
    until = context.usable_until()
    return recorded_changes(change.session, live.current, after, until, now)


def _live_machine(context: Context, change: MachineChange) -> LiveMachine:
    """Give the machine in memory, with the version that is active in the database."""
    live = context.live.get(change.row.id)
    if live is None or live.current.version != change.row.active_version:
        live = load_machine(context, change.row.id)
    return live


def _present_change(
    context: Context, change: MachineChange, after: ModelWithEffects
) -> PresentChange:
    """Compute the table at the latest reading with the active model, and with another."""
    if change.row.active_version is None:
        return PresentChange("there is no active model yet")
    live = _live_machine(context, change)
    other = _with_model(context, live, after)
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


def compare_now(context: Context, machine_id: str, a: int, b: int) -> PresentChange:
    """Say by how much tables with two versions differ at the latest reading."""
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        machine = stored_machine(row).machine
        versions = [find_version(session, machine_id, number) for number in (a, b)]
    live = context.live.get(machine_id) or load_machine(context, machine_id)
    tables = []
    for version in versions:
        try:
            other = _with_model(context, live, effective_model(machine, version))
            state = current_state(context, machine_id, other)
            tables.append(current_table(context, state))
        except ThermapError as error:
            return PresentChange(f"with v{version.version} there is no table now: {error.detail}")
    return _changes_between(*tables)


def _used_temperatures(current: CurrentTable) -> dict[str, float]:
    sensors = current.state.sensors
    return {s.sensor: s.temperature_c for s in sensors if s.temperature_c is not None}


def _with_model(context: Context, live: LiveMachine, after: ModelWithEffects) -> LiveMachine:
    """Set another model beside a machine's readings, with the past that its effects need."""
    other, model = LiveMachine(_with_other(live.current, after)), after.model
    window = live.readings.held
    # A window of its own: what becomes usable meanwhile is the live machine's to take in.
    other.readings.replace(model.machine, [*window.used, *window.ahead], context.usable_until())
    other.is_behind = False
    if live.past.serves(model.machine, other.current.needed):
        other.past = live.past
    else:
        restore_past(context, other)
    return other


def _with_other(now: LiveModel, other: ModelWithEffects) -> LiveModel:
    return LiveModel(
        other.model, now.version, now.created_at, now.revision, now.loaded_at, tuple(other.effects)
    )


@dataclass(frozen=True, slots=True)
class ModelMap(Answer):
    """One of the maps that a version is made of."""

    id: int
    """The map's number"""
    label: Annotated[str, Field(examples=["Run #1"])]
    """The map's name"""
    temperatures_c: Mapping[str, float]
    """Its sensors' temperatures [°C]"""


@dataclass(frozen=True, kw_only=True)
class ModelAnswer(Answer):
    """One immutable version of a machine's model: its maps, its assignment and its effects.

    Tables are computed with it under the machine's settings (`out_of_range`, `same_temperature`,
    the sensors' `resolution_c` …) as they are now: changing these changes tables at once.
    """

    version: Annotated[int, Field(examples=[3])]
    """Number of the version"""
    active: bool
    """Whether tables are computed with it now"""
    waiting: bool
    """Whether it waits for its activation because its tables would lose something"""
    created_at: datetime
    """When it was made, UTC"""
    reason: Annotated[str, Field(examples=["map 'Run #3' stored"])]
    """What made it"""
    maps: Sequence[ModelMap]
    """The error maps that it is made of"""
    assignment: Mapping[str, str]
    """Component to sensor"""
    effects: Sequence[AdoptedEffect]
    """Adopted effects"""


@dataclass(frozen=True, kw_only=True)
class ChangedModelAnswer(ModelAnswer, ModelChange):
    """A version that was made or activated, and what its tables lose and gain by it."""


def _as_answered(version: ModelVersion, active: int | None, waiting: int | None) -> dict[str, Any]:
    """Give the fields of `ModelAnswer`, by the numbers of the active and of the waiting version."""
    return {
        "version": version.version,
        "active": version.version == active,
        "waiting": version.version == waiting,
        "created_at": version.created_at,
        "reason": version.reason,
        "maps": [
            ModelMap(m.id, m.error_map.label, m.error_map.temperatures_c) for m in version.maps
        ],
        "assignment": _in_order(version.assignment),
        "effects": list(map(adopted_effect, adopted_effects(version))),
    }


def _in_order(assignment: Mapping[str, str]) -> dict[str, str]:
    """Put an assignment in the order of the components."""
    return {code: assignment[code] for code in sorted(assignment, key=ORDER.__getitem__)}


def changed_model(made: MadeVersion) -> ChangedModelAnswer:
    """Show a version that was made or activated."""
    number = made.version.version
    active, waiting = (number, None) if made.is_active else (None, number)
    head = _as_answered(made.version, active, waiting)
    return ChangedModelAnswer(**head, **fields_of(made.change))


def show_models(context: Context, machine_id: str) -> list[ModelAnswer]:
    """List a machine's model versions, oldest first."""
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        numbers = (row.active_version, row.waiting_version)
        versions = list_versions(session, machine_id)
    return [ModelAnswer(**_as_answered(version, *numbers)) for version in versions]


def show_model(context: Context, machine_id: str, version: int) -> ModelAnswer:
    """Read one model version."""
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        stored = find_version(session, machine_id, version)
        return ModelAnswer(**_as_answered(stored, row.active_version, row.waiting_version))


@dataclass(frozen=True, slots=True)
class ModelCoverage(Answer, published_as="ModelCoverageAnswer"):
    """Which components the tables of a version have."""

    model_version: Annotated[int, Field(examples=[3])]
    """Number of the version"""
    components: Annotated[Sequence[str], Field(examples=[["EXX", "EZZ"]])]
    """Components of its tables"""
    omitted: Annotated[Mapping[str, str], Field(examples=[{"EYY": "no sensor is assigned to it"}])]
    """Component of its maps that no table has, to the reason"""


def show_coverage(context: Context, machine_id: str, version: int) -> ModelCoverage:
    """Compile a version, to see which components its tables have.

    Raises
    ------
    InvalidContent, Conflict
        If the machine's present sensors no longer fit it.
    """
    with context.database.reading() as session:
        machine = stored_machine(find_machine(session, machine_id)).machine
        after = effective_model(machine, find_version(session, machine_id, version))
    return ModelCoverage(version, sorted(after.codes, key=ORDER.__getitem__), after.model.omitted)


@repeated
def activate_model(context: Context, machine_id: str, version: int) -> ChangedModelAnswer:
    """Activate a version, whatever its tables lose: the answer says what.

    Another version that waited waits no more, for the next one is made of the active one.

    Raises
    ------
    InvalidContent, Conflict
        If the machine's present sensors no longer fit it.
    """
    with changing_machine(context, machine_id) as change:
        stored = find_version(change.session, machine_id, version)
        difference = difference_to_active(context, change, effective_model(change.machine, stored))
        was_active = change.row.active_version
        if was_active != version:
            activate_version(change.row, version)
            note_version(context, change, stored, was_active, is_active=True)
        set_waiting(change.row, None)
        made = made_version(change, stored, difference)
    return changed_model(made)


def preview_activation(context: Context, machine_id: str, version: int) -> Preview:
    """Say what activating a version would do, and leave everything as it is.

    Raises
    ------
    UnknownThing, InvalidContent, Conflict
        As `activate_model`.
    """
    with reading_machine(context, machine_id) as change:
        after = effective_model(change.machine, find_version(change.session, machine_id, version))
        return preview(context, change, f"version {version} activated", after, activates=True)


_PATTERN: Final = re.compile(r"(?=.*\*)[A-Z*^xyz]{1,6}")
"""A component's code with `*` for any letters."""


def _expect_components(assignment: Any) -> Any:
    """Refuse unknown names before their values: who wraps an assignment is told of the name."""
    errors = []
    for name in assignment if isinstance(assignment, dict) else ():
        try:
            _code(name)
        except UnknownComponent as unknown:
            errors.append(FieldError(name, unknown.detail))
    if errors:
        raise InvalidContent("; ".join(e.message for e in errors), errors)
    return assignment


def _code(name: str) -> str:
    return name if _PATTERN.fullmatch(name) else parse_component(name)[0].code


def _by_code(assignment: Mapping[str, str]) -> dict[str, str]:
    by_code: dict[str, str] = {}
    for name, sensor in assignment.items():
        if by_code.setdefault(_code(name), sensor) != sensor:
            raise InvalidContent.of_field(name, f"{_code(name)} is assigned to two sensors")
    return by_code


Assignment: TypeAlias = Annotated[
    dict[str, str],
    made(_expect_components, kind=BeforeValidator),
    made(_by_code),
    Field(
        description="Component to the sensor that it follows. Components are named by code or in "
        "the chapter's notation; `E*X` stands for all components of the maps whose code fits, and "
        "gives way to a component that is named itself",
        examples=[{"E*X": "x-middle", "EZZ": "z-column"}],
    ),
]
"""As it is stated; made, it has codes."""


@dataclass(frozen=True, kw_only=True)
class WaitingAssignmentAnswer(ModelChange):
    """An assignment whose version waits, because its tables would lose something."""

    assignment: Mapping[str, str]
    """Component to sensor, in the waiting version"""


@repeated
def assign_sensors(
    context: Context,
    machine_id: str,
    assignment: Mapping[str, str],
    *,
    accept_losses: bool = False,
) -> Mapping[str, str] | WaitingAssignmentAnswer:
    """Assign sensors to components (codes); the others keep theirs. Answer with all of them.

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
        if draft is None:
            made = activate_waiting(context, change, accept_losses=accept_losses)
            version = change.latest
        else:
            made = make_version(context, change, draft, accept_losses=accept_losses)
            version = made.version
        in_order = _in_order(version.assignment if version else {})
    if made is None or made.is_active:
        return in_order
    return WaitingAssignmentAnswer(assignment=in_order, **fields_of(made.change))


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
            return preview_stored(context, change, "it is assigned so already", change.latest)
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


def sensor_assignment(context: Context, machine_id: str) -> dict[str, str]:
    """Read the active version's assignment."""
    _, version = _machine_and_version(context, machine_id)
    return _in_order(version.assignment if version else {})


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
