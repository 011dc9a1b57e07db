"""Make any version of a machine's model the active one again."""

from __future__ import annotations

from app.services.change_model import changing_machine
from app.services.context import Context
from app.storage.model_versions import activate_version, find_version
from app.storage.records import ModelVersion


def activate_model(context: Context, machine_id: str, version: int) -> ModelVersion:
    """Activate a version.

    Raises
    ------
    UnknownThing
        If there is no such version.
    InvalidContent, Conflict
        If the machine's present sensors no longer fit it.
    """
    with changing_machine(context, machine_id) as change:
        found = find_version(change.session, machine_id, version)
        if change.row.active_version != version:
            activate_version(change.row, version)
    return found
