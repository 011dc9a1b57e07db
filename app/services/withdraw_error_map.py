"""Take an error map out of use."""

from __future__ import annotations

from app.services.change_model import (
    changing_machine,
    draft_version,
    make_version,
    remake_waiting,
)
from app.services.context import Context
from app.services.repeating import repeated
from app.storage.error_maps import find_error_map, withdraw_error_map


@repeated
def withdraw_map(context: Context, machine_id: str, map_id: int) -> None:
    """Delete a map from the machine; versions made of it keep it.

    If the active version contains it, the next version is the same without it, and active
    whatever it loses: that is what deleting means. A version that waits is made anew without it.

    Raises
    ------
    UnknownThing
        If the machine has no such map.
    """
    with changing_machine(context, machine_id) as change:
        row = find_error_map(change.session, machine_id, map_id)
        withdraw_error_map(row, context.now())
        active, waiting = change.version, change.waiting
        if active is not None and any(m.id == map_id for m in active.maps):
            remaining = [m for m in active.maps if m.id != map_id]
            draft = draft_version(change, active, remaining, f"map {row.label!r} deleted")
            make_version(context, change, draft, accept_losses=True)
        if waiting is not None and any(m.id == map_id for m in waiting.maps):
            remake_waiting(context, change, waiting, without=[map_id])
