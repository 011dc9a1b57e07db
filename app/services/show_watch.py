"""Whether a machine still is as its model says."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime

from app.identification.watch.watching import WatchState
from app.services.choose_version import no_model_yet
from app.services.context import Context
from app.storage.machines import find_machine
from app.storage.records import StoredVerification
from app.storage.verifications import list_verifications
from app.storage.watches import find_watch


@dataclass(frozen=True, slots=True)
class Watch:
    """Where the sequential test of the active version stands, and the verifications it judged.

    `updated_at` is None before the first one.
    """

    model_version: int
    state: WatchState
    updated_at: datetime | None
    judged: list[StoredVerification]

    @property
    def beyond_since(self) -> datetime | None:
        """Time of the visit with which the limit was first exceeded."""
        since_s = self.state.beyond_since_s
        return None if since_s is None else datetime.fromtimestamp(since_s, UTC)


def show_watch(context: Context, machine_id: str) -> Watch:
    """Read where the watch of the active version stands.

    Raises
    ------
    UnknownThing
        If there is no such machine.
    Conflict
        If it has no model yet.
    """
    with context.database.reading() as session:
        version = find_machine(session, machine_id).active_version
        if version is None:
            raise no_model_yet(machine_id)
        known = find_watch(session, machine_id, version)
        judged = [
            v
            for v in list_verifications(session, machine_id)
            if v.judgement is not None and v.judgement.model_version == version
        ]
    if known is None:
        return Watch(version, WatchState(), None, judged)
    return Watch(version, known.state, known.updated_at, judged)
