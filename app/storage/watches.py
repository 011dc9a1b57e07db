"""Where the sequential test of each model version stands."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final, NamedTuple

from pydantic import TypeAdapter, ValidationError
from sqlalchemy import select
from sqlalchemy.orm import Session

from app.identification.watch.figures import WatchFigures
from app.identification.watch.watching import WatchState
from app.storage.tables import MachineRow, WatchRow
from app.storage.watch_shapes import WATCH_STATES

NOT_JUDGED: Final = "not-judged"
"""Nothing that was measured could be judged yet."""


@dataclass(frozen=True, slots=True)
class StoredWatch:
    """A state as it is stored, and since when; comparing it does not need to read it."""

    written: Mapping[str, Any]
    updated_at: datetime

    @property
    def state(self) -> WatchState:
        """The state; InvalidContent where it cannot be read."""
        return WATCH_STATES.read(self.written)


def find_watch(session: Session, machine_id: str, model_version: int) -> StoredWatch | None:
    """Read what was stored last, and when; None before the first verification."""
    row = session.get(WatchRow, (machine_id, model_version))
    return None if row is None else StoredWatch(row.state, row.updated_at)


def watch_status(session: Session, machine: MachineRow) -> str | None:
    """Say what the watch of a machine's active version says; None before it says anything."""
    query = select(WatchRow.status).where(
        WatchRow.machine_id == machine.id,
        WatchRow.model_version == machine.active_version,
        WatchRow.status != NOT_JUDGED,
    )
    return session.scalar(query)


def watch_statuses(session: Session) -> dict[str, str]:
    """Say the same of all machines that are watched."""
    query = select(WatchRow.machine_id, WatchRow.status).join(
        MachineRow,
        (MachineRow.id == WatchRow.machine_id)
        & (MachineRow.active_version == WatchRow.model_version)
        & (WatchRow.status != NOT_JUDGED),
    )
    return {row.machine_id: row.status for row in session.execute(query)}


_FIGURES: Final = TypeAdapter(WatchFigures)


class Watched(NamedTuple):
    """What the watch of a machine's active version says, since when it is beyond, its figures."""

    status: str
    beyond_since: datetime | None = None
    figures: WatchFigures | None = None


NOT_WATCHED = Watched(NOT_JUDGED)


def watched_machine(session: Session, machine: MachineRow) -> Watched:
    """Say where the watch of a machine's active version stands."""
    status = watch_status(session, machine)
    if status is None or machine.active_version is None:
        return NOT_WATCHED
    return Watched(status, _beyond_since(session, machine.id, machine.active_version))


def watched_machines(session: Session) -> dict[str, Watched]:
    """Say of every machine with verifications where its active version's watch stands."""
    query = select(
        WatchRow.machine_id, WatchRow.model_version, WatchRow.status, WatchRow.state["figures"]
    ).join(
        MachineRow,
        (MachineRow.id == WatchRow.machine_id)
        & (MachineRow.active_version == WatchRow.model_version),
    )
    watched = {}
    for machine_id, version, status, figures in session.execute(query).all():
        since = _beyond_since(session, machine_id, version) if status == "beyond" else None
        watched[machine_id] = Watched(status, since, _read_figures(figures))
    return watched


def _read_figures(stored: Any) -> WatchFigures | None:
    with suppress(ValidationError):  # what a later version writes otherwise is not told
        return None if stored is None else _FIGURES.validate_python(stored)
    return None


def _beyond_since(session: Session, machine_id: str, model_version: int) -> datetime | None:
    stored = find_watch(session, machine_id, model_version)
    since_s = None if stored is None else stored.state.beyond_since_s
    return None if since_s is None else datetime.fromtimestamp(since_s, UTC)


def write_watch(
    session: Session,
    machine_id: str,
    model_version: int,
    state: WatchState,
    now: datetime,
) -> None:
    """Store where the test stands now; the machine is locked."""
    row = session.get(WatchRow, (machine_id, model_version))
    if row is None:
        row = WatchRow(machine_id=machine_id, model_version=model_version)
        session.add(row)
    judged = "within" if state.streams else NOT_JUDGED
    row.status = judged if state.beyond_since_s is None else "beyond"
    row.state = WATCH_STATES.fields(state)
    row.updated_at = now
