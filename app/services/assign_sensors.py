"""Say which sensor each component follows, and propose it by correlation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from app.errors import FieldError, InvalidContent, UnknownThing
from app.services.change_model import (
    Draft,
    MachineChange,
    MadeVersion,
    activate_waiting,
    changing_machine,
    draft_version,
    looking_at_machine,
    make_version,
)
from app.services.context import Context
from app.services.preview_model import Preview, preview_draft, preview_latest
from app.services.repeating import repeated
from app.storage.machines import find_machine, stored_machine
from app.storage.model_versions import active_version
from app.storage.records import ModelVersion
from app.thermal.machine import Machine
from app.thermal.sensor_assignment import Proposal, propose_assignment


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
    context, machine_id, assignment
        The service, whose sensors, and component code to sensor.
    accept_losses
        Whether the version is activated although it loses something against the active one.

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
            made = make_version(context, change, draft, accept_losses=accept_losses)
            return Assigned(made.version.assignment, made)
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
    with looking_at_machine(context, machine_id) as change:
        draft = _draft(change, assignment)
        if draft is None:
            return preview_latest(context, change, "it is assigned so already")
        return preview_draft(context, change, draft)


def _draft(change: MachineChange, assignment: Mapping[str, str]) -> Draft | None:
    """Put the version together that has the assignment; None where there is one already."""
    _check_sensors(change.machine, assignment)
    base = change.latest
    known = dict(base.assignment) if base else {}
    if known | dict(assignment) == known:
        return None
    named = ", ".join(f"{code} to {sensor}" for code, sensor in assignment.items())
    maps = base.maps if base else []
    return draft_version(change, base, maps, f"assigned {named}"[:500], assignment)


def sensor_assignment(context: Context, machine_id: str) -> Mapping[str, str]:
    """Read the active version's assignment."""
    _, version = _machine_and_version(context, machine_id)
    return version.assignment if version else {}


def correlate_sensors(context: Context, machine_id: str) -> list[Proposal]:
    """Correlate the active version's maps with every sensor; nothing changes."""
    machine, version = _machine_and_version(context, machine_id)
    if version is None:
        return []
    return propose_assignment(machine, [m.error_map for m in version.maps], version.assignment)


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
