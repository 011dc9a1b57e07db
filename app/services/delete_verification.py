"""Delete a verification."""

from __future__ import annotations

from app.services.context import Context
from app.storage.machines import find_machine
from app.storage.verifications import find_verification


def delete_verification(context: Context, machine_id: str, verification_id: int) -> None:
    """Delete a verification; analyses of it keep their results.

    Raises
    ------
    UnknownThing
        If the machine has no such verification.
    """
    with context.database.writing() as session:
        find_machine(session, machine_id, lock=True)
        session.delete(find_verification(session, machine_id, verification_id))
