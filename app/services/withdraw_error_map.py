"""Take an error map out of use."""

from __future__ import annotations

from app.services.change_model import (
    Draft,
    MachineChange,
    changing_machine,
    draft_version,
    looking_at_machine,
    make_version,
    remake_waiting,
)
from app.services.context import Context
from app.services.preview_model import Preview, preview_draft, preview_unchanged
from app.services.repeating import repeated
from app.storage.error_maps import find_error_map, withdraw_error_map
from app.storage.tables import ErrorMapRow


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
        waiting = change.waiting
        draft = _without(change, row)
        if draft is not None:
            make_version(context, change, draft, accept_losses=True)
        if waiting is not None and any(m.id == map_id for m in waiting.maps):
            remake_waiting(context, change, waiting, without=[map_id])


def preview_withdrawal(context: Context, machine_id: str, map_id: int) -> Preview:
    """Say what deleting a map would do to the tables, and delete nothing.

    Raises
    ------
    UnknownThing
        If the machine has no such map.
    """
    with looking_at_machine(context, machine_id) as change:
        row = find_error_map(change.session, machine_id, map_id)
        draft = _without(change, row)
        if draft is None:
            reason = f"map {row.label!r} deleted, which the active model does not have"
            return preview_unchanged(context, change, reason)
        return preview_draft(context, change, draft, activates=True)


def _without(change: MachineChange, row: ErrorMapRow) -> Draft | None:
    """Put the active version together without a map; None where it does not have that map."""
    active = change.version
    if active is None or all(stored.id != row.id for stored in active.maps):
        return None
    remaining = [stored for stored in active.maps if stored.id != row.id]
    return draft_version(change, active, remaining, f"map {row.label!r} deleted")
