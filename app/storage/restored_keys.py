"""Which keys a database has after a backup was restored into it.

Keys say who may do what now, and a backup says who might then: a key that was revoked since must
not come back without a word. So a database that has keys, or had some, goes on with its own. One
that never had any takes those of the backup. Sessions of browsers are never restored.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Final

from sqlalchemy import Connection, Row, delete, insert, select, update
from sqlalchemy.orm import Session

from app.events.event import EventKind
from app.storage.access_keys import readable_key
from app.storage.events import write_event
from app.storage.log_numbers import number_entries
from app.storage.tables import AccessKeyRow, EventRow, MachineRow

_KEY: Final = AccessKeyRow.__table__


@dataclass(frozen=True, slots=True)
class RestoredKeys:
    """What became of keys, by name: of the database, then of the backup.

    Parameters
    ----------
    remain
        Of the database: they stay as they are.
    revoked
        Of the database, but for machines alone that the backup does not have.
    restored
        Of the backup, brought into the database.
    left_out
        Of the backup: the database does not have them, as they were revoked since, or made
        elsewhere, or it has another key of the name.
    unreadable
        Of the backup, with a role or machines that this version does not know.
    """

    remain: Sequence[str] = ()
    revoked: Sequence[str] = ()
    restored: Sequence[str] = ()
    left_out: Sequence[str] = ()
    unreadable: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class KeysBefore:
    """A database's keys, whether it ever had any, and when its machines were made."""

    rows: Sequence[Row[Any]]
    had_any: bool
    machines: Mapping[str, datetime]


def keys_before(target: Connection) -> KeysBefore:
    """Look at a database before anything in it is replaced."""
    rows = target.execute(select(_KEY).order_by(_KEY.c.id)).all()
    told_of = select(EventRow.id).where(EventRow.kind == str(EventKind.KEY)).limit(1)
    had_any = bool(rows) or target.execute(told_of).first() is not None
    return KeysBefore(rows, had_any, _machines(target))


def restore_keys(
    source: Connection, target: Connection, before: KeysBefore, *, with_keys: bool
) -> RestoredKeys:
    """Settle which keys there are, once the backup's machines are in the database.

    Parameters
    ----------
    with_keys
        Whether keys that the database does not have come back although it has or had keys.
    """
    revoked = _keep_to_machines(target, before)
    own_names = {row.name for row in before.rows} - set(revoked)
    own_digests = {row.digest for row in before.rows if row.name in own_names}
    restored, left_out, unreadable = [], [], []
    for row in source.execute(select(_KEY).order_by(_KEY.c.id)):
        if row.digest in own_digests:
            continue
        if readable_key(row) is None:
            unreadable.append(row.name)
        elif row.name in own_names or (before.had_any and not with_keys):
            left_out.append(row.name)
        else:
            # Under a number of the database's own: no number is used again.
            values = {name: value for name, value in row._mapping.items() if name != "id"}
            target.execute(insert(AccessKeyRow).values(**values))
            restored.append(row.name)
    names = (sorted(own_names), revoked, restored, left_out, unreadable)
    return RestoredKeys(*map(tuple, names))


def note_restored_keys(target: Connection, keys: RestoredKeys, now: datetime) -> None:
    """Write into the event log, which is the backup's now, what became of keys."""
    if keys == RestoredKeys():
        return
    with Session(target) as session:
        details = {
            "remain": [*keys.remain],
            "revoked": [*keys.revoked],
            "restored": [*keys.restored],
            "left_out": [*keys.left_out, *keys.unreadable],
        }
        words = [f"{what.replace('_', ' ')}: {', '.join(n)}" for what, n in details.items() if n]
        text = f"backup restored; keys {'; '.join(words)}"
        write_event(session, None, EventKind.KEY, text, now, details)
        number_entries(session)
        session.flush()


def _keep_to_machines(target: Connection, before: KeysBefore) -> list[str]:
    """Let keys be for those of their machines that are the same ones still."""
    there = _machines(target)
    revoked = []
    for row in before.rows:
        if not isinstance(row.machines, list):
            continue
        same = [m for m in row.machines if there.get(m, 0) == before.machines.get(m)]
        if not same:
            target.execute(delete(AccessKeyRow).where(_KEY.c.id == row.id))
            revoked.append(row.name)
        elif same != row.machines:
            target.execute(update(AccessKeyRow).where(_KEY.c.id == row.id).values(machines=same))
    return revoked


def _machines(connection: Connection) -> dict[str, datetime]:
    rows = connection.execute(select(MachineRow.id, MachineRow.created_at))
    return {row.id: row.created_at for row in rows}
