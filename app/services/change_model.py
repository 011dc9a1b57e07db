"""Make the next model version: check it whole, write it, and let live tables follow.

Every use case that changes what a machine's tables say goes through
`changing_machine`: one transaction that holds the machine's lock, and after its
commit one step that puts the new model in place in memory.

Every new version is held against the active one (`app.effects.adopted.model_difference`). One
that loses nothing is activated. One that loses something is stored and waits, and the versions
after it are made of it: what is stored meanwhile is in them, and when somebody activates the
last one, or it loses nothing any more, all of it goes live together.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field
from sqlalchemy.orm import Session

from app.answer import Answer
from app.effects.adopted.carry_over import Change, carry_over
from app.effects.adopted.model_difference import (
    ModelDifference,
    ModelWithEffects,
    Part,
    model_difference,
)
from app.effects.effect import Effect
from app.errors import Conflict, StorageUnavailable, UnknownThing
from app.events.event import EventKind
from app.services.context import Context
from app.services.load_machine import (
    adopted_effects,
    compile_version,
    effective_model,
    live_model,
    restore_past,
)
from app.services.note_watch import noting_watch
from app.storage.events import write_event
from app.storage.machines import RowLock, find_machine, stored_machine
from app.storage.model_versions import (
    activate_version,
    active_version,
    find_version,
    insert_version,
    set_waiting,
    waiting_version,
)
from app.storage.news import NewsKind, tell
from app.storage.records import ModelVersion, StoredMap
from app.storage.tables import MachineRow
from app.thermal.compile_model import compile_model
from app.thermal.machine import Machine


@dataclass(frozen=True, slots=True)
class MachineChange:
    """A machine inside a transaction: under its lock where that changes it."""

    session: Session
    row: MachineRow

    @property
    def machine(self) -> Machine:
        """The machine as it is now."""
        return stored_machine(self.row).machine

    @property
    def version(self) -> ModelVersion | None:
        """The active version now."""
        return active_version(self.session, self.row)

    @property
    def waiting(self) -> ModelVersion | None:
        """The version that waits to be activated, where there is one."""
        return waiting_version(self.session, self.row)

    @property
    def latest(self) -> ModelVersion | None:
        """The version that contains all that was stored: the waiting one, else the active one."""
        return self.waiting or self.version


@dataclass(frozen=True, slots=True, eq=False)
class Draft:
    """The next version before it is written: what it is made of, compiled and so checked."""

    maps: Sequence[StoredMap]
    assignment: Mapping[str, str]
    reason: str
    effective: ModelWithEffects


@dataclass(frozen=True, slots=True)
class WaitingMap(Answer, published_as="WaitingMapAnswer"):
    """A map that the version that waits has, and the active one has not."""

    id: Annotated[int, Field(examples=[4])]
    """The map's number"""
    label: Annotated[str, Field(examples=["short"])]
    """The map's name"""


@dataclass(frozen=True, slots=True)
class WaitedBefore(Answer, published_as="WaitedBeforeAnswer"):
    """What waited already when this version was made: this version contains it."""

    model_version: Annotated[int, Field(examples=[4])]
    """The version that waited"""
    maps: Sequence[WaitingMap]
    """Its maps that the active version has not: without them nothing waits, or something else"""
    loses: Sequence[Part]
    """Which of the version's `loses` are its doing; the others are new"""


@dataclass(frozen=True, kw_only=True)
class ModelChange(Answer, whole=False):
    """Which version was made, and whether tables are computed with it."""

    model_version: Annotated[int | None, Field(examples=[4])] = None
    """The version that was made"""
    activated: bool | None = None
    """Whether it is active; a version that loses something waits until somebody activates it, and
    the next ones are made of it"""
    loses: Sequence[Part] = ()
    """What its tables lack against those of the version active before"""
    gains: Sequence[Part] = ()
    """What its tables have beyond those"""
    next_step: str | None = None
    """How to activate it all the same; null where it is active"""
    waited_before: WaitedBefore | None = None
    """What waited already; null where nothing did"""
    stays_active: int | None = None
    """The version that stays active while this one waits; null where it is"""


@dataclass(frozen=True, slots=True, eq=False)
class MadeVersion:
    """A version that was made or activated, and what becomes of the tables by that."""

    version: ModelVersion
    change: ModelChange

    @property
    def is_active(self) -> bool:
        """Whether tables are computed with it."""
        return bool(self.change.activated)


def made_version(
    change: MachineChange,
    version: ModelVersion,
    difference: ModelDifference,
    waited: WaitedBefore | None = None,
) -> MadeVersion:
    """Say what the machine's tables lose and gain by a version against the one active before."""
    number, active = version.version, change.row.active_version
    is_active = number == active
    how_to_activate = (
        f"Version {number} is stored and waits, because its tables would lose something; version "
        f"{active} of machine {change.row.id!r} stays active. Activating {number} lets tables "
        f"follow it all the same; activating {active} again gives it up, and deleting the map that "
        "would lose something takes that out. Versions made meanwhile contain what it contains."
    )
    return MadeVersion(
        version,
        ModelChange(
            model_version=number,
            activated=is_active,
            loses=difference.loses,
            gains=difference.gains,
            next_step=None if is_active else how_to_activate,
            waited_before=waited,
            stays_active=None if is_active else active,
        ),
    )


@contextmanager
def changing_machine(context: Context, machine_id: str) -> Iterator[MachineChange]:
    """Lock a machine, let the caller change it, check, commit, publish.

    The model that results is compiled before the commit, so a change that would
    leave the machine without a consistent model is rolled back whole.

    Raises
    ------
    InvalidContent, Conflict
        If the maps, the assignment and the machine's sensors contradict each other.
    """
    with context.database.writing() as session:
        row = find_machine(session, machine_id, RowLock.CHANGED)
        with noting_watch(session, row, context.now()):
            yield MachineChange(session, row)
        tell(session, NewsKind.MACHINE, machine_id)
        live = live_model(context, session, row)
    machine = context.live.publish(live)
    with suppress(StorageUnavailable, UnknownThing):  # the follower tries again
        restore_past(context, machine)


@contextmanager
def reading_machine(context: Context, machine_id: str) -> Iterator[MachineChange]:
    """Let the caller see what a change would make, without making it; UnknownThing as above."""
    with context.database.reading() as session:
        yield MachineChange(session, find_machine(session, machine_id))


def draft_version(
    change: MachineChange,
    base: ModelVersion | None,
    maps: Iterable[StoredMap],
    reason: str,
    assignment: Mapping[str, str] | None = None,
    effects: Sequence[Effect] | None = None,
) -> Draft:
    """Put the version together that has these maps.

    The assignment is written out in full: what the version before said or the user
    now says, and the defaults for components that are new. A later change of the
    machine's sensors thus cannot change what a version says.

    Without `effects` those of the version before are carried over as far as they still hold
    (`app.effects.adopted.carry_over`); the reason says which are left out, and why.

    Parameters
    ----------
    maps, assignment, effects
        All its maps; what is assigned otherwise than in the base; its effects.

    Raises
    ------
    InvalidContent, Conflict
        As `compile_model`.
    """
    stored_maps = list(maps)
    machine = change.machine
    full = dict(base.assignment if base else {}) | dict(assignment or {})
    for stored in stored_maps:
        for code in stored.error_map.tables:
            default = machine.default_sensor(code)
            if code not in full and default is not None:
                full[code] = default
    error_maps = [stored.error_map for stored in stored_maps]
    model = compile_model(machine, error_maps, full)
    notes: list[str] = []
    if effects is None:
        effects = adopted_effects(base)
        if base is not None and effects:
            map_ids = {stored.id for stored in base.maps}
            new_maps = [stored.error_map for stored in stored_maps if stored.id not in map_ids]
            before = compile_version(machine, base)
            effects, notes = carry_over(effects, Change(before, model, error_maps, new_maps))
    return Draft(stored_maps, full, "; ".join([reason, *notes]), ModelWithEffects(model, effects))


def difference_to_active(
    context: Context, change: MachineChange, after: ModelWithEffects
) -> ModelDifference:
    """Say what a model lacks against the active one, and what it has beyond it."""
    before = effective_model(change.machine, change.version)
    return model_difference(before, after, _known_states(context, change.row.id))


def waited_before(
    context: Context, change: MachineChange, loses: Sequence[Part]
) -> WaitedBefore | None:
    """Say what waits already, before a version is made that loses this: it may be its doing."""
    active, waiting = change.version, change.waiting
    if active is None or waiting is None:
        return None
    after = effective_model(change.machine, waiting)
    map_ids = {stored.id for stored in active.maps}
    lost = difference_to_active(context, change, after).loses
    return WaitedBefore(
        model_version=waiting.version,
        maps=[WaitingMap(m.id, m.error_map.label) for m in waiting.maps if m.id not in map_ids],
        loses=[part for part in loses if any(known.contains(part) for known in lost)],
    )


def _known_states(context: Context, machine_id: str) -> set[str] | None:
    """Name the states that readings state; None without a reading, or where none is in memory."""
    live = context.live.get(machine_id)
    latest = None if live is None else live.readings.latest
    if live is None or latest is None:
        return None
    return {*latest.state, *live.past.now.states_at(latest.time.timestamp())}


def make_version(
    context: Context, change: MachineChange, draft: Draft, *, accept_losses: bool = False
) -> MadeVersion:
    """Write a version, and activate it unless it loses something against the active one.

    Parameters
    ----------
    accept_losses
        Whether it is activated whatever it loses.
    """
    difference = difference_to_active(context, change, draft.effective)
    before = waited_before(context, change, difference.loses)
    version = insert_version(
        change.session,
        change.row,
        [stored.id for stored in draft.maps],
        draft.assignment,
        [effect.to_json() for effect in draft.effective.effects],
        draft.reason,
        context.now(),
    )
    #     made ── loses nothing, or that is accepted ──▶ active: tables follow it
    #       │                                              ▲
    #       └── loses something ──▶ waiting ───────────────┘ somebody accepts what it loses, or a
    #                                 │  ▲                   later version made of it loses nothing
    #                                 └──┘
    #                  what is stored meanwhile is made of it, or it anew of another active one
    is_active = accept_losses or not difference.loses
    was_active = change.row.active_version
    if is_active:
        activate_version(change.row, version.version)
    else:
        set_waiting(change.row, version.version)
    note_version(context, change, version, was_active, is_active=is_active)
    return made_version(change, version, difference, before)


def note_version(
    context: Context,
    change: MachineChange,
    version: ModelVersion,
    was_active: int | None,
    *,
    is_active: bool,
) -> None:
    """Write into the log which version tables follow from now on, or which one waits."""
    if is_active and was_active is not None and was_active > version.version:
        words = f"went back from v{was_active} to v{version.version}"
    elif is_active:
        words = f"v{version.version} active: {version.reason}"
    else:
        words = f"v{version.version} stored and waits: {version.reason}"
    write_event(
        change.session,
        change.row.id,
        EventKind.MODEL,
        words,
        context.now(),
        {"version": version.version, "from": was_active, "to": change.row.active_version},
    )


def activate_waiting(
    context: Context, change: MachineChange, *, accept_losses: bool
) -> MadeVersion | None:
    """Say what the version that waits loses, if any does, and activate it if that is wanted."""
    waiting = change.waiting
    if waiting is None:
        return None
    difference = difference_to_active(context, change, effective_model(change.machine, waiting))
    if accept_losses:
        was_active = change.row.active_version
        activate_version(change.row, waiting.version)
        note_version(context, change, waiting, was_active, is_active=True)
    return made_version(change, waiting, difference)


def remake_waiting(
    context: Context,
    change: MachineChange,
    waiting: ModelVersion | None,
    without: Collection[int] = (),
) -> MadeVersion | None:
    """Make the version that waited anew, of the active one that was just changed.

    It has the maps and the assignment that it had, and those of the active version's effects
    that hold with them. Where nothing is left that the active version lacks, nothing waits.

    Parameters
    ----------
    context, change
        The service, and the machine under its lock, its active version already the new one.
    without
        Numbers of maps that it loses.
    """
    active = change.version
    if waiting is None or active is None:
        return None
    maps = [stored for stored in waiting.maps if stored.id not in without]
    if _is_same(maps, waiting.assignment, active):
        set_waiting(change.row, None)
        return None
    reason = f"{waiting.reason} (made anew of version {active.version})"
    draft = draft_version(change, active, maps, reason, waiting.assignment)
    return make_version(context, change, draft)


def _is_same(
    maps: Sequence[StoredMap], assignment: Mapping[str, str], version: ModelVersion
) -> bool:
    """Whether maps with an assignment are what a version is made of."""
    if {m.id for m in maps} != {m.id for m in version.maps}:
        return False
    codes = {code for m in maps for code in m.error_map.tables}
    return all(assignment.get(code) == version.assignment.get(code) for code in codes)


def choose_version(
    session: Session, machine_id: str, version_number: int | None = None
) -> tuple[Machine, ModelVersion]:
    """Find a machine and a version of its model; the active one where none is stated.

    Raises
    ------
    Conflict
        If the machine has no model yet.
    """
    row = find_machine(session, machine_id)
    version = (
        active_version(session, row)
        if version_number is None
        else find_version(session, machine_id, version_number)
    )
    if version is None:
        raise no_model_yet(machine_id)
    return stored_machine(row).machine, version


def no_model_yet(machine_id: str) -> Conflict:
    """Make the refusal of what needs a model, on a machine before its first error map."""
    return Conflict(f"machine {machine_id!r} has no model yet: store error maps first")
