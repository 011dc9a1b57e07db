"""Read verifications as they are stored."""

from __future__ import annotations

from app.effects.observations import Verification
from app.services.context import Context
from app.storage.machines import find_machine
from app.storage.records import StoredVerification
from app.storage.verifications import (
    find_verification,
    list_verifications,
    read_verification,
    stored_verification,
)


def show_verifications(context: Context, machine_id: str) -> list[StoredVerification]:
    """List a machine's verifications, oldest first."""
    with context.database.reading() as session:
        find_machine(session, machine_id)
        return list_verifications(session, machine_id)


def show_verification(
    context: Context, machine_id: str, verification_id: int
) -> tuple[StoredVerification, Verification]:
    """Read one verification with its observations; UnknownThing if there is none."""
    with context.database.reading() as session:
        find_machine(session, machine_id)
        row = find_verification(session, machine_id, verification_id, observations=True)
        return stored_verification(row), read_verification(row)
