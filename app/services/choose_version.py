"""Choose the version of a machine's model that a request is about."""

from __future__ import annotations

from sqlalchemy.orm import Session

from app.errors import Conflict
from app.storage.machines import find_machine, stored_machine
from app.storage.model_versions import active_version, find_version
from app.storage.records import ModelVersion
from app.thermal.machine import Machine


def choose_version(
    session: Session, machine_id: str, version_number: int | None = None
) -> tuple[Machine, ModelVersion]:
    """Find a machine and a version of its model; the active one where none is stated.

    Raises
    ------
    UnknownThing
        If there is no such machine or version.
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
