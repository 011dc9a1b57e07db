"""Say which sensor each component follows, and propose it by correlation."""

from __future__ import annotations

from collections.abc import Mapping

from app.errors import FieldError, InvalidContent, UnknownThing
from app.services.change_model import changing_machine, next_version
from app.services.context import Context
from app.storage.machines import find_machine, stored_machine
from app.storage.model_versions import active_version
from app.storage.records import ModelVersion
from app.thermal.machine import Machine
from app.thermal.sensor_assignment import Proposal, propose_assignment


def assign_sensors(
    context: Context, machine_id: str, assignment: Mapping[str, str]
) -> Mapping[str, str]:
    """Assign sensors to components (codes); the others keep theirs.

    Returns
    -------
    mapping
        The whole assignment, component code to sensor.

    Raises
    ------
    InvalidContent
        If a sensor is unknown, or a map lacks a sensor's temperature.
    Conflict
        If maps are too close at a sensor.
    """
    with changing_machine(context, machine_id) as change:
        _check_sensors(change.machine, assignment)
        before = change.version
        known = dict(before.assignment) if before else {}
        if known | dict(assignment) == known:
            return known
        named = ", ".join(f"{code} to {sensor}" for code, sensor in assignment.items())
        maps = before.maps if before else []
        version = next_version(context, change, maps, f"assigned {named}"[:500], assignment)
    return version.assignment


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
