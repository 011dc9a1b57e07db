"""Delete a machine with all its maps, models and readings."""

from __future__ import annotations

from app.services.context import Context
from app.services.repeating import repeated
from app.storage.limits import LONG
from app.storage.machines import Held, find_machine


@repeated
def delete_machine(context: Context, machine_id: str) -> None:
    """Delete everything about a machine.

    Raises
    ------
    UnknownThing
        If there is no such machine.
    """
    with context.database.writing(LONG) as session:
        session.delete(find_machine(session, machine_id, Held.DELETED))
    context.live.forget(machine_id)
