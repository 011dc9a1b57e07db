"""Make the next model version: check it whole, write it, and let live tables follow.

Every use case that changes what a machine's tables say goes through
`changing_machine`: one transaction that holds the machine's lock, and after its
commit one step that puts the new model in place in memory.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass

from sqlalchemy.orm import Session

from app.errors import StorageUnavailable, UnknownThing
from app.identification.carry_over import Change, carry_over
from app.identification.effects.effect import Effect
from app.services.context import Context
from app.services.load_machine import (
    adopted_effects,
    compile_version,
    live_model,
    load_machine,
)
from app.services.restore_past import restore_past
from app.storage.machines import find_machine, stored_machine
from app.storage.model_versions import active_version, insert_version
from app.storage.records import ModelVersion, StoredMap
from app.storage.tables import MachineRow
from app.thermal.compile_model import compile_model
from app.thermal.machine import Machine


@dataclass(frozen=True, slots=True)
class MachineChange:
    """A machine under its lock, inside the transaction that changes it."""

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


@contextmanager
def changing_machine(context: Context, machine_id: str) -> Iterator[MachineChange]:
    """Lock a machine, let the caller change it, check, commit, publish.

    The model that results is compiled before the commit, so a change that would
    leave the machine without a consistent model is rolled back whole.

    Raises
    ------
    UnknownThing
        If there is no such machine.
    InvalidContent, Conflict
        If the maps, the assignment and the machine's sensors contradict each other.
    """
    with context.database.writing() as session:
        row = find_machine(session, machine_id, lock=True)
        yield MachineChange(session, row)
        session.flush()
        live = live_model(context, session, row)
    if context.live.get(machine_id) is None:
        # Not in memory yet: with its readings, or it would seem to have had none.
        with suppress(StorageUnavailable, UnknownThing):
            load_machine(context, machine_id)
    machine = context.live.publish(live)
    with suppress(StorageUnavailable):  # the follower tries again
        restore_past(context, machine)


def next_version(
    context: Context,
    change: MachineChange,
    maps: Iterable[StoredMap],
    reason: str,
    assignment: Mapping[str, str] | None = None,
    effects: Sequence[Effect] | None = None,
) -> ModelVersion:
    """Write and activate the version made of these maps.

    The assignment is written out in full: what the last version said or the user
    now says, and the defaults for components that are new. A later change of the
    machine's sensors thus cannot change what a version says.

    Without `effects` those of the last version are carried over as far as they still hold
    (`app.identification.carry_over`); the version's reason says which are left out, and why.
    """
    stored_maps = list(maps)
    before = change.version
    full = dict(before.assignment if before else {}) | dict(assignment or {})
    for stored in stored_maps:
        for code in stored.error_map.tables:
            default = change.machine.default_sensor(code)
            if code not in full and default is not None:
                full[code] = default
    notes: list[str] = []
    if effects is None:
        effects, notes = _carried_over(change.machine, before, stored_maps, full)
    return insert_version(
        change.session,
        change.row,
        [m.id for m in stored_maps],
        full,
        [effect.to_json() for effect in effects],
        "; ".join([reason, *notes]),
        context.now(),
    )


def _carried_over(
    machine: Machine,
    before: ModelVersion | None,
    maps: Sequence[StoredMap],
    assignment: Mapping[str, str],
) -> tuple[Sequence[Effect], list[str]]:
    """Keep the last version's effects that hold with these maps and this assignment."""
    effects = adopted_effects(before)
    if before is None or not effects:
        return effects, []
    error_maps = [stored.error_map for stored in maps]
    known = {stored.id for stored in before.maps}
    new_maps = [stored.error_map for stored in maps if stored.id not in known]
    after = compile_model(machine, error_maps, assignment)
    return carry_over(
        effects, Change(compile_version(machine, before), after, error_maps, new_maps)
    )
