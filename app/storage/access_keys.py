"""Keys, and the browsers in which they were stated."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from datetime import datetime
from typing import NamedTuple

from sqlalchemy import delete, select, update
from sqlalchemy.orm import Session

from app.access.keys import AccessKey, Role
from app.errors import Conflict, UnknownThing, list_names
from app.storage.news import NewsKind, tell
from app.storage.tables import AccessKeyRow, BrowserSessionRow


class Known(NamedTuple):
    """A key, and until when what states it is good for it; None for the key itself."""

    key: AccessKey
    expires_at: datetime | None


def stored_keys(session: Session) -> list[AccessKey]:
    """List all keys by name."""
    rows = session.scalars(select(AccessKeyRow).order_by(AccessKeyRow.name))
    return [_key(row) for row in rows]


def known_digests(session: Session) -> dict[str, Known]:
    """Give what every key and every browser is known by."""
    rows = list(session.scalars(select(AccessKeyRow)))
    keys = {row.id: _key(row) for row in rows}
    known = {row.digest: Known(keys[row.id], None) for row in rows}
    for browser in session.scalars(select(BrowserSessionRow)):
        if browser.key_id in keys:
            known[browser.digest] = Known(keys[browser.key_id], browser.expires_at)
    return known


def add_key(
    session: Session,
    name: str,
    role: Role,
    machines: tuple[str, ...] | None,
    digest: str,
    now: datetime,
) -> AccessKey:
    """Store a key.

    Raises
    ------
    Conflict
        If there is one of this name.
    """
    if session.scalar(select(AccessKeyRow.id).where(AccessKeyRow.name == name)) is not None:
        raise Conflict(f"there is a key {name!r} already: revoke it first, or choose another name")
    row = AccessKeyRow(
        name=name,
        role=str(role),
        machines=None if machines is None else list(machines),
        digest=digest,
        created_at=now,
    )
    session.add(row)
    session.flush()
    tell(session, NewsKind.KEYS)
    return _key(row)


def delete_key(session: Session, name: str) -> None:
    """Delete a key, and with it every browser in which it was stated.

    Raises
    ------
    UnknownThing
        If there is none of this name; it lists those that there are.
    """
    number = session.scalar(select(AccessKeyRow.id).where(AccessKeyRow.name == name))
    if number is None:
        names = session.scalars(select(AccessKeyRow.name).order_by(AccessKeyRow.name))
        raise UnknownThing(f"there is no key {name!r}; there are: {list_names(names)}")
    session.execute(delete(BrowserSessionRow).where(BrowserSessionRow.key_id == number))
    session.execute(delete(AccessKeyRow).where(AccessKeyRow.id == number))
    tell(session, NewsKind.KEYS)


def unbind_machine(session: Session, machine_id: str) -> dict[str, bool]:
    """Let no key be for a machine any more: one that was for no other is deleted.

    Returns
    -------
    dict
        Names of the keys that were for it, and whether each was deleted.
    """
    # JSON is not searched alike by both databases, and keys are few.
    limited = select(AccessKeyRow).order_by(AccessKeyRow.id).with_for_update()
    found: dict[str, bool] = {}
    for row in session.scalars(limited).all():
        if row.machines is None or machine_id not in row.machines:
            continue
        others = [other for other in row.machines if other != machine_id]
        found[row.name] = not others
        if others:
            row.machines = others
            tell(session, NewsKind.KEYS)
        else:
            delete_key(session, row.name)
    return found


def turn_of_admins(session: Session) -> list[str]:
    """Name the keys of admins; whoever else asks waits until this transaction has ended."""
    rows = (
        select(AccessKeyRow.name)
        .where(AccessKeyRow.role == str(Role.ADMIN))
        .order_by(AccessKeyRow.id)
        .with_for_update()
    )
    return list(session.scalars(rows))


def note_uses(session: Session, used_at: Mapping[int, datetime]) -> None:
    """Note when keys were used last."""
    for number, time in used_at.items():
        session.execute(
            update(AccessKeyRow).where(AccessKeyRow.id == number).values(last_used_at=time)
        )


def add_browser(session: Session, digest: str, key_id: int, now: datetime, end: datetime) -> None:
    """Remember a browser, and forget those whose time is over."""
    session.execute(delete(BrowserSessionRow).where(BrowserSessionRow.expires_at <= now))
    session.add(BrowserSessionRow(digest=digest, key_id=key_id, expires_at=end))
    tell(session, NewsKind.KEYS)


def delete_browsers(session: Session, digests: Iterable[str]) -> None:
    """Forget browsers."""
    session.execute(delete(BrowserSessionRow).where(BrowserSessionRow.digest.in_(list(digests))))
    tell(session, NewsKind.KEYS)


def _key(row: AccessKeyRow) -> AccessKey:
    machines = None if row.machines is None else tuple(row.machines)
    return AccessKey(row.id, row.name, Role(row.role), machines, row.created_at, row.last_used_at)
