"""Create a machine."""

from __future__ import annotations

from sqlalchemy.exc import IntegrityError

from app.errors import Conflict
from app.live.registry import Arrived
from app.services.context import Context
from app.services.load_machine import as_live, compile_version
from app.services.repeating import repeated
from app.storage.machines import insert_machine
from app.storage.records import StoredMachine
from app.thermal.machine import Machine


@repeated
def create_machine(context: Context, machine: Machine) -> StoredMachine:
    """Store a new machine.

    Raises
    ------
    Conflict
        If there is a machine of that id.
    """
    try:
        with context.database.writing() as session:
            stored = insert_machine(session, machine, context.now())
    except IntegrityError:
        raise Conflict(
            f"there is a machine {machine.id!r} already; change it, or choose another id"
        ) from None
    live = context.live.publish(as_live(context, stored, None, compile_version(machine, None)))
    live.reread(Arrived((), 0), (), context.usable_until())
    return stored
