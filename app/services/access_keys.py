"""Keys: making and revoking them, and knowing them again without asking the database."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from datetime import datetime, timedelta
from threading import Lock
from time import monotonic
from typing import Final

from sqlalchemy.orm import Session

from app.access.keys import (
    AccessKey,
    NewAccessKey,
    Role,
    checked_name,
    digest_of,
    new_secret,
)
from app.errors import Conflict, InvalidContent, StorageUnavailable, list_names
from app.events.event import EventKind
from app.services.context import Context, repeated, utc_now
from app.storage.access_keys import (
    Known,
    add_browser,
    add_key,
    delete_browsers,
    delete_key,
    known_digests,
    note_uses,
    stored_keys,
    turn_of_admins,
    unbind_machine,
)
from app.storage.database import Database
from app.storage.events import write_event
from app.storage.limits import QUESTION
from app.storage.machines import hold_machines, list_machines

BROWSER_LASTS: Final = timedelta(days=30)
"""How long a browser need not be told the key again."""

USE_NOTED_EVERY: Final = timedelta(minutes=1)
"""How exactly the last use of a key is stored: a key is used a hundred times a second."""

FIRST_KEY: Final = "admin"
"""Name of the key that a service makes for itself."""


@repeated
def create_key(
    database: Database,
    name: str,
    role: Role,
    machines: Sequence[str] | None = None,
    now: Callable[[], datetime] = utc_now,
) -> NewAccessKey:
    """Make a key.

    Parameters
    ----------
    machines
        Ids of stored machines that it is for, one or more; None for all.

    Raises
    ------
    InvalidContent
        If the name cannot be one, a machine does not exist, none is named where some are to be,
        or an admin is to be for some only.
    Conflict
        If there is a key of this name.
    """
    checked_name(name)
    if machines is not None:
        _check_limits(role, machines)
    secret = new_secret()
    with database.writing() as session:
        chosen = None
        if machines is not None:
            chosen = tuple(dict.fromkeys(machines))
            kept = hold_machines(session, chosen)
            _check_machines(chosen, [stored.machine.id for stored in list_machines(session)])
            if len(kept) < len(chosen):
                raise Conflict("a machine that the key is to be for is being deleted")
        key = add_key(session, name, role, chosen, digest_of(secret), now())
        whole = "all machines" if chosen is None else list_names(chosen)
        text = f"key {name!r} made: {role}, for {whole}"
        details = {"key": name, "role": str(role), "machines": chosen}
        write_event(session, None, EventKind.KEY, text, now(), details)
    return NewAccessKey(key, secret)


def _check_limits(role: Role, machines: Sequence[str]) -> None:
    if role is Role.ADMIN:
        raise InvalidContent.of_field(
            "machines", "expected none for the role admin, which makes and deletes machines"
        )
    if not machines:
        # No machine must never be read as every machine.
        raise InvalidContent.of_field("machines", "expected one or more ids, or null for all")


def _check_machines(chosen: Sequence[str], known: Collection[str]) -> None:
    for machine in chosen:
        if machine not in known:
            raise InvalidContent.of_field(
                "machines", f"expected one of {list_names(known)}, got {machine[:80]!r}"
            )


def create_first_key(database: Database) -> str | None:
    """Make an admin's key where there is no key at all.

    Returns
    -------
    str or None
        The key itself; None where there are keys.
    """
    with database.reading() as session:
        if stored_keys(session):
            return None
    return create_key(database, FIRST_KEY, Role.ADMIN).secret


def show_keys(database: Database) -> list[AccessKey]:
    """List all keys by name, with their last use."""
    with database.reading() as session:
        return stored_keys(session)


@repeated
def revoke_key(
    database: Database,
    name: str,
    now: Callable[[], datetime] = utc_now,
    *,
    last_admin: bool = False,
) -> None:
    """Let a key be none any more; services know at once on PostgreSQL, else within `refresh_s`.

    Parameters
    ----------
    last_admin
        Whether it may be the last one of an admin: who asks knows that from then on only the
        command line beside the database makes keys.

    Raises
    ------
    UnknownThing
        If there is none of this name.
    Conflict
        If it is the last one of an admin, unless `last_admin`.
    """
    with database.writing() as session:
        admins = turn_of_admins(session)  # or two who revoke each other both succeed
        if admins == [name] and not last_admin:
            raise Conflict(
                f"{name!r} is the last key of an admin: without it nobody makes or revokes keys, "
                "nor machines, but by `thermap keys create` beside the database; make another "
                "admin's key first, or say that it may be the last one (last_admin)"
            )
        delete_key(session, name)
        write_event(session, None, EventKind.KEY, f"key {name!r} revoked", now(), {"key": name})


def unbind_keys(session: Session, machine_id: str, now: datetime) -> None:
    """Let keys that were for a machine not fit another one that gets its id.

    Who deletes or makes a machine does this in the same transaction: what an older version left
    is no key to a new machine either.
    """
    for name, is_gone in unbind_machine(session, machine_id).items():
        text = (
            f"key {name!r} revoked with its only machine, {machine_id!r}"
            if is_gone
            else f"key {name!r} is no longer for {machine_id!r}, which was deleted"
        )
        details = {"key": name, "machine": machine_id}
        write_event(session, None, EventKind.KEY, text, now, details)


class KeyRing:
    """The keys in memory, as they were in the database a moment ago.

    While the database is away the keys go on as they were last known: a table that compensates a
    machine does not stop for it.

    Parameters
    ----------
    context
        Of the service as it is then.
    every_s
        How old what is known may be before the database is asked again [s].
    """

    def __init__(self, context: Callable[[], Context], every_s: float) -> None:
        self._context = context
        self._every_s = every_s
        self._known: dict[str, Known] = {}
        self._asked_s: float | None = None
        self.is_known = False
        """Whether the database has ever answered."""
        self._used: dict[int, datetime] = {}
        self._stored_uses: dict[int, datetime] = {}
        self._asking = Lock()

    @property
    def is_due(self) -> bool:
        """Whether the database is to be asked again."""
        return self._asked_s is None or monotonic() - self._asked_s >= self._every_s

    def refresh(self) -> None:
        """Ask the database which keys there are, and tell it which were used."""
        with self._asking:  # or an older answer could take the place of a newer one
            self._asked_s = monotonic()
            database = self._context().database
            try:
                with database.reading(QUESTION) as session:
                    self._known = known_digests(session)
                self.is_known = True
                self._store_uses(database)
            except StorageUnavailable:
                return

    def find(self, secret: str) -> AccessKey | None:
        """Find the key that a secret states, from memory."""
        known = self._known.get(digest_of(secret))
        now = self._context().now()
        if known is None or (known.expires_at is not None and known.expires_at <= now):
            return None
        self._used[known.key.id] = now
        return known.key

    def open_browser(self, key: AccessKey) -> str:
        """Make what a browser states from now on instead of a key."""
        secret = new_secret()
        context = self._context()
        now = context.now()
        end = now + BROWSER_LASTS
        with self._asking:
            with context.database.writing() as session:
                add_browser(session, digest_of(secret), key.id, now, end)
            self._known = self._known | {digest_of(secret): Known(key, end)}
        return secret

    def close_browser(self, secret: str) -> None:
        """Forget a browser."""
        with self._context().database.writing() as session:
            delete_browsers(session, [digest_of(secret)])
        self.refresh()

    def _store_uses(self, database: Database) -> None:
        stored = {known.key.id for known in self._known.values()}
        due = {
            number: time
            for number, time in self._used.items()
            if number in stored
            and time - self._stored_uses.get(number, datetime.min.replace(tzinfo=time.tzinfo))
            >= USE_NOTED_EVERY
        }
        if due:
            with database.writing(QUESTION) as session:
                note_uses(session, due)
            self._stored_uses |= due
