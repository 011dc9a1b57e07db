"""Take an error map out of use."""

from __future__ import annotations

from app.services.change_model import changing_machine, next_version
from app.services.context import Context
from app.storage.error_maps import find_error_map, withdraw_error_map


def withdraw_map(context: Context, machine_id: str, map_id: int) -> None:
    """Delete a map from the machine; versions made of it keep it.

    If the active version contains it, the next version is the same without it.

    Raises
    ------
    UnknownThing
        If the machine has no such map.
    """
    with changing_machine(context, machine_id) as change:
        row = find_error_map(change.session, machine_id, map_id)
        withdraw_error_map(row, context.now())
        maps = change.version.maps if change.version else []
        remaining = [m for m in maps if m.id != map_id]
        if len(remaining) < len(maps):
            next_version(context, change, remaining, f"map {row.label!r} deleted")
