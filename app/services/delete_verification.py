"""Delete a verification."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy.orm import Session

from app.errors import InvalidContent
from app.identification.watch.watching import WatchState, watch
from app.services.choose_version import choose_version
from app.services.context import Context
from app.services.load_campaign import load_campaign, read_verifications
from app.services.repeating import repeated
from app.storage.machines import Held, find_machine
from app.storage.records import StoredVerification
from app.storage.verifications import find_verification, list_verifications, stored_verification
from app.storage.watches import write_watch


@repeated
def delete_verification(context: Context, machine_id: str, verification_id: int) -> None:
    """Delete a verification; analyses of it keep their results.

    The watch that had judged it is computed anew from those that it judged beside it.

    Raises
    ------
    UnknownThing
        If the machine has no such verification.
    """
    with context.database.writing() as session:
        find_machine(session, machine_id, Held.CHANGED)
        row = find_verification(session, machine_id, verification_id)
        version = _judged_by(stored_verification(row))
        session.delete(row)
        session.flush()
        if version is not None:
            state = _watched(session, machine_id, version, context.usable_until())
            write_watch(session, machine_id, version, state, context.now())


def _watched(session: Session, machine_id: str, version_number: int, until: datetime) -> WatchState:
    """Judge again all verifications that a version has judged, in their order."""
    judged = [
        v.id for v in list_verifications(session, machine_id) if _judged_by(v) == version_number
    ]
    if not judged:
        return WatchState()
    machine, version = choose_version(session, machine_id, version_number)
    verifications = read_verifications(session, machine_id, judged)
    try:
        campaign = load_campaign(session, machine, version, verifications, until)
        return watch(campaign, WatchState(), version_number)[1]
    except InvalidContent:
        # Nothing of them can be compared any more, as when readings were deleted.
        return WatchState()


def _judged_by(verification: StoredVerification) -> int | None:
    """Say which version has judged a verification; None where none could."""
    return None if verification.judgement is None else verification.judgement.model_version
