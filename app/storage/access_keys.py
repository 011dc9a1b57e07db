"""Keys, and the browsers in which they were stated."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from datetime import datetime
from typing import Any, Final, NamedTuple

from sqlalchemy import Row, Select, delete, insert, select, update
from sqlalchemy.orm import Session

from app.access.authorization import Authorization, asking
from app.access.keys import AccessKey, Role
from app.errors import Conflict, UnknownThing, list_names
from app.storage.news import NewsKind, tell
from app.storage.tables import AccessKeyRow, BrowserSessionRow, MachineRow

MOST_SESSIONS: Final = 2000
"""Browsers of all keys: all of them are in the memory of every service."""

MOST_SESSIONS_OF_KEY: Final = 20
"""Browsers of one key: who opens another one ends the one that was opened first."""

_KEY: Final = AccessKeyRow.__table__.c
_SESSION: Final = BrowserSessionRow.__table__.c

HOLD_KEYS: Final = (
    "SELECT digest, id, name, role, machines, created_at, last_used_at FROM access_key "
    "WHERE digest = ANY(%(digests)s) FOR KEY SHARE"
)
"""On the driver's own connection to PostgreSQL: keys, none of which is revoked meanwhile."""

_CONFIRMED: Final = "thermap_confirmed"


class Birth(NamedTuple):
    """Which of the machines that have had an id one is: when it was made, where its log begins."""

    created_at: datetime
    entries_after: int


class StoredKey(NamedTuple):
    """A key that what somebody states is good for.

    `expires_at` is None for the key itself. `births` are those of the machines that it is for; of
    a key for all machines there are none.
    """

    key: AccessKey
    expires_at: datetime | None
    births: Mapping[str, Birth]


def stored_keys(session: Session) -> list[AccessKey]:
    """List all keys by name that this version can read."""
    rows = session.execute(select(*_KEY).order_by(_KEY.name))
    return [key for row in rows if (key := readable_key(row)) is not None]


def unreadable_keys(session: Session) -> list[str]:
    """Name the keys that a newer version, or somebody by hand, wrote: here they are none."""
    rows = session.execute(select(*_KEY).order_by(_KEY.name))
    return [row.name for row in rows if readable_key(row) is None]


def has_keys(session: Session) -> bool:
    """Whether there is any key, be it one that this version cannot read."""
    return session.scalar(select(_KEY.id).limit(1)) is not None


def keys_by_digest(session: Session) -> dict[str, StoredKey]:
    """Give what every key and every browser is known by."""
    # Machines first: one that is made between the two questions is then not yet there for its key,
    # and never there for the key of an older one of its id.
    machines = session.execute(
        select(MachineRow.id, MachineRow.created_at, MachineRow.entries_after)
    )
    births = {machine_id: Birth(born, after) for machine_id, born, after in machines}
    stored: dict[str, StoredKey] = {}
    by_number: dict[int, StoredKey] = {}
    for row in session.execute(select(*_KEY)):
        key = readable_key(row)
        if key is not None:
            of_its = {m: births[m] for m in key.machines or () if m in births}
            stored[row.digest] = by_number[row.id] = StoredKey(key, None, of_its)
    newest = select(*_SESSION).order_by(_SESSION.expires_at.desc()).limit(MOST_SESSIONS)
    for browser in session.execute(newest):
        if browser.key_id in by_number:
            long_key = by_number[browser.key_id]
            stored[browser.digest] = long_key._replace(expires_at=browser.expires_at)
    return stored


def confirm_authorization(session: Session, *, locked: bool) -> None:
    """Refuse the request that is answered unless its key may still do what it asks.

    Once in a transaction, and after it has locked everything else: those who revoke keys lock the
    machine first, too.

    Parameters
    ----------
    locked
        Whether the key cannot be revoked until the transaction ends: what is written and the
        revoking have an order then. SQLite has one writer at a time anyway.

    Raises
    ------
    AccessRefused
        If it may not any more.
    """
    authorization = asking.get()
    if authorization is not None and not session.info.get(_CONFIRMED):
        confirm_one(session, authorization, locked=locked)
        session.info[_CONFIRMED] = True


def confirm_one(session: Session, authorization: Authorization, *, locked: bool) -> None:
    """Do the same for what was authorized otherwise than by the request that is answered."""
    digest = authorization.digest
    by_key = select(*_KEY).where(_KEY.digest == digest)
    key = _key_of(session, by_key, locked)
    if key is None:
        number = select(_SESSION.key_id).where(_SESSION.digest == digest)
        if locked:
            number = number.with_for_update(read=True, key_share=True)
        by_session = select(*_KEY).where(_KEY.id == session.scalar(number))
        key = _key_of(session, by_session, locked)
    authorization.confirm(key)


def confirm_held(authorizations: Collection[Authorization], rows: Iterable[Any]) -> None:
    """Do the same for several at once, with the answer to `HOLD_KEYS`."""
    keys = {digest: _key_from(*columns) for digest, *columns in rows}
    for authorization in authorizations:
        authorization.confirm(keys.get(authorization.digest))


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
    if session.scalar(select(_KEY.id).where(_KEY.name == name)) is not None:
        raise Conflict(f"there is a key {name!r} already: revoke it first, or choose another name")
    stored = None if machines is None else list(machines)
    row = AccessKeyRow(name=name, role=str(role), machines=stored, digest=digest, created_at=now)
    session.add(row)
    session.flush()
    tell(session, NewsKind.KEYS)
    return AccessKey(row.id, name, role, machines, now, None)


def delete_key(session: Session, name: str) -> None:
    """Delete a key, and with it every browser in which it was stated.

    Raises
    ------
    UnknownThing
        If there is none of this name; it lists those that there are.
    """
    number = session.scalar(select(_KEY.id).where(_KEY.name == name))
    if number is None:
        names = session.scalars(select(_KEY.name).order_by(_KEY.name))
        raise UnknownThing(f"there is no key {name!r}; there are: {list_names(names)}")
    confirm_authorization(session, locked=True)  # it may be the key that asks
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
    is_deleted: dict[str, bool] = {}
    for row in session.scalars(limited).all():
        if not isinstance(row.machines, list) or machine_id not in row.machines:
            continue
        others = [other for other in row.machines if other != machine_id]
        is_deleted[row.name] = not others
        if others:
            row.machines = others
            tell(session, NewsKind.KEYS)
        else:
            delete_key(session, row.name)
    return is_deleted


def turn_of_admins(session: Session) -> list[str]:
    """Name the keys of admins; whoever else asks waits until this transaction has ended."""
    rows = select(_KEY.name).where(_KEY.role == str(Role.ADMIN)).order_by(_KEY.id).with_for_update()
    return list(session.scalars(rows))


def note_uses(session: Session, used_at: Mapping[int, datetime]) -> None:
    """Note when keys were used last."""
    for number, time in used_at.items():
        session.execute(
            update(AccessKeyRow).where(AccessKeyRow.id == number).values(last_used_at=time)
        )


def add_browser(
    session: Session, key_digest: str, digest: str, now: datetime, end: datetime
) -> AccessKey | None:
    """Remember a browser in which a key was stated; None, and nothing, where there is none.

    Forgotten are those whose time is over and, beyond the limits, those that were opened first.
    """
    # Who states the same key waits: else both would find room for one more.
    locked = select(*_KEY).where(_KEY.digest == key_digest).with_for_update(key_share=True)
    row = session.execute(locked).one_or_none()
    key = None if row is None else readable_key(row)
    if key is None or not key.role.includes(Role.VIEWER):
        return None
    session.execute(delete(BrowserSessionRow).where(_SESSION.expires_at <= now))
    last_first = select(_SESSION.digest).order_by(_SESSION.expires_at.desc(), _SESSION.digest)
    of_key = last_first.where(_SESSION.key_id == key.id).offset(MOST_SESSIONS_OF_KEY - 1)
    for surplus in (of_key, last_first.offset(MOST_SESSIONS - 1)):
        _delete_browsers(session, session.scalars(surplus).all())
    session.execute(insert(BrowserSessionRow).values(digest=digest, key_id=key.id, expires_at=end))
    tell(session, NewsKind.KEYS)
    return key


def delete_browser(session: Session, digest: str) -> None:
    """Forget a browser."""
    _delete_browsers(session, [digest])
    tell(session, NewsKind.KEYS)


def _delete_browsers(session: Session, digests: Sequence[str]) -> None:
    for start in range(0, len(digests), MOST_SESSIONS):
        some = digests[start : start + MOST_SESSIONS]
        session.execute(delete(BrowserSessionRow).where(_SESSION.digest.in_(some)))


def _key_of(session: Session, query: Select[Any], locked: bool) -> AccessKey | None:
    if locked:
        query = query.with_for_update(read=True, key_share=True)
    row = session.execute(query).one_or_none()
    return None if row is None else readable_key(row)


def readable_key(row: Row[Any]) -> AccessKey | None:
    """Read a row; None for what this version does not write, which gives nobody any rights."""
    return _key_from(row.id, row.name, row.role, row.machines, row.created_at, row.last_used_at)


def _key_from(
    number: int,
    name: str,
    role: str,
    machines: Any,
    created_at: datetime,
    last_used_at: datetime | None,
) -> AccessKey | None:
    is_list = isinstance(machines, list) and all(
        isinstance(machine_id, str) for machine_id in machines
    )
    if role not in list(Role) or not (machines is None or (is_list and machines)):
        return None
    chosen = None if machines is None else tuple(machines)
    return AccessKey(number, name, Role(role), chosen, created_at, last_used_at)
