"""What the watch says, written into the log when it says something else."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from typing import Final

from sqlalchemy.orm import Session

from app.events.event import EventKind
from app.storage.events import write_event
from app.storage.tables import MachineRow
from app.storage.watches import watched_machine

_SAYS: Final = {
    "within": "no lasting change is proved",
    "beyond": "the machine drifts from its model",
    "not-judged": "nothing that was measured can be judged by it yet",
}


@contextmanager
def noting_watch(session: Session, row: MachineRow, now: datetime) -> Iterator[None]:
    """Let the watch go on, or another version be active; write into the log what it says then.

    Parameters
    ----------
    row
        The machine, under its lock.
    """
    before = watched_machine(session, row)
    yield
    session.flush()
    after = watched_machine(session, row)
    if after.status == before.status:
        return
    version = row.active_version
    details = {"version": version, "from": before.status, "to": after.status}
    if after.beyond_since is not None:
        details["since"] = after.beyond_since.isoformat()
    text = f"the watch of v{version}: {_SAYS[after.status]}"
    write_event(session, row.id, EventKind.WATCH, text, now, details)
