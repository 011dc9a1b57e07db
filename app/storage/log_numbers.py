"""Numbers by which those who follow the event log know what they have had.

An entry has a new number each time that it is written: when it is made, when an alarm goes and
when it comes again. Numbers are given at the end of a transaction, one transaction at a time, so
what has a larger number was committed later: who has read up to a number misses nothing below it.
On SQLite transactions that write follow each other anyway; on PostgreSQL a lock is held from the
numbers to the commit. Nothing else is waited for meanwhile, so nobody stands in another's way.
"""

from __future__ import annotations

from typing import Final

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from app.storage.news import NewsKind, tell
from app.storage.tables import EventRow

NUMBERING: Final = 7_483_625
"""PostgreSQL advisory lock: one transaction at a time gives numbers and commits."""

_WRITTEN: Final = "thermap_log"


def note_entry(session: Session, row: EventRow) -> None:
    """Note in a transaction that an entry is written, and is to have a number."""
    session.info.setdefault(_WRITTEN, {})[row] = None


def number_entries(session: Session) -> bool:
    """Give numbers at the end of a transaction; True where there was something to number."""
    rows: dict[EventRow, None] = session.info.pop(_WRITTEN, {})
    if not rows:
        return False
    session.flush()  # all other locks are taken before this one
    if session.get_bind().dialect.name == "postgresql":
        session.execute(select(func.pg_advisory_xact_lock(NUMBERING)))
    #     A   rows ── flush ──[lock ─ max 7 ─ writes 8 ─ commit]
    #     B   rows ── flush ── waits ......................[lock ─ max 8 ─ writes 9 ─ commit]
    #
    # A statement of its own after the lock: at READ COMMITTED, PostgreSQL's usual level, it sees
    # what the one before has committed. The lock goes with the commit, after it.
    last = session.scalar(select(func.max(EventRow.number))) or 0
    for number, row in enumerate(rows, last + 1):
        row.number = number
    tell(session, NewsKind.LOG)
    return True
