"""Keys: making and revoking them, and knowing them again without asking the database."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from datetime import datetime, timedelta
from threading import Lock
from time import monotonic
from typing import Final

from pydantic import Field
from sqlalchemy.orm import Session

from app.access.authorization import as_service
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
from app.services.background import Background
from app.services.context import Context, repeated, utc_now
from app.stated import Name, Schema
from app.storage.access_keys import (
    StoredKey,
    add_browser,
    add_key,
    delete_browser,
    delete_key,
    has_keys,
    keys_by_digest,
    note_uses,
    stored_keys,
    turn_of_admins,
    unbind_machine,
    unreadable_keys,
)
from app.storage.database import Database
from app.storage.events import write_event
from app.storage.limits import QUESTION
from app.storage.machines import hold_machines, list_machines

log = logging.getLogger("thermap")

BROWSER_LASTS: Final = timedelta(days=30)
"""How long a browser need not be told the key again."""

USE_NOTED_EVERY: Final = timedelta(minutes=1)
"""How exactly the last use of a key is stored: a key is used a hundred times a second."""

FIRST_KEY: Final = "admin"
"""Name of the key that a service makes for itself."""


class KeyRequest(Schema):
    """A key that is to be made."""

    name: str = Field(
        description="Whose it is: 1 to 64 letters, digits, dots, hyphens and underscores",
        examples=["line-3"],
    )
    role: Role = Field(
        description="`sensor` sends readings, `viewer` reads and computes, `metrologist` does "
        "both and changes models, `admin` makes machines and keys too"
    )
    machines: list[Name] | None = Field(
        default=None,
        max_length=10_000,
        description="Ids of the machines that it is for, one or more; null for all, also those "
        "that are made later. An admin is for all",
        examples=[["mcfv5050"]],
    )


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
            locked = hold_machines(session, chosen)
            _check_machines(chosen, [stored.machine.id for stored in list_machines(session)])
            if len(locked) < len(chosen):
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


def _check_machines(chosen: Sequence[str], machines: Collection[str]) -> None:
    for machine in chosen:
        if machine not in machines:
            raise InvalidContent.of_field(
                "machines", f"expected one of {list_names(machines)}, got {machine[:80]!r}"
            )


def create_first_key(database: Database) -> str | None:
    """Make an admin's key where there is no key at all.

    Returns
    -------
    str or None
        The key itself; None where there are keys.
    """
    with database.reading() as session:
        if has_keys(session):
            return None
    return create_key(database, FIRST_KEY, Role.ADMIN).secret


def show_unreadable_keys(database: Database) -> list[str]:
    """Name the keys that are none here, because this version cannot read what they are for."""
    with database.reading() as session:
        return unreadable_keys(session)


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
    """

    def __init__(self, context: Callable[[], Context]) -> None:
        self._context = context
        self._stored: Mapping[str, StoredKey] = {}
        self._unreadable: Sequence[str] = ()
        self.asked_s = -math.inf
        """When the database was asked last, of the clock that only goes forward [s]."""
        self.is_known = False
        """Whether the database has ever answered."""
        self._used: dict[int, datetime] = {}
        self._stored_uses: dict[int, datetime] = {}
        self._asking = Lock()

    def now(self) -> datetime:
        """Read the service's clock."""
        return self._context().now()

    @as_service()
    def refresh(self) -> None:
        """Ask the database which keys there are."""
        with self._asking:  # or an older answer could take the place of a newer one
            self.asked_s = monotonic()
            try:
                with self._context().database.reading(QUESTION) as session:
                    self._stored = keys_by_digest(session)
                    unreadable = unreadable_keys(session)
            except StorageUnavailable:
                return
            self.is_known = True
        if unreadable != self._unreadable:
            self._unreadable = unreadable
            for name in unreadable:
                log.warning("key %r is none here: a newer version wrote it, or somebody", name)

    def find(self, digest: str) -> StoredKey | None:
        """Find what a digest is good for, from memory."""
        stored = self._stored.get(digest)
        now = self.now()
        if stored is None or (stored.expires_at is not None and stored.expires_at <= now):
            return None
        self._used[stored.key.id] = now
        return stored

    def sees(self, stored: StoredKey, machine_id: str) -> bool:
        """Whether a key is for the machine of this id that there is now.

        A machine that was made anew under an old id is another one: a key for the older one may
        still be in memory.
        """
        if not stored.key.sees(machine_id):
            return False
        live = self._context().live.get(machine_id)
        if stored.key.machines is None or live is None:
            return True
        birth = stored.births.get(machine_id)
        return birth is not None and birth.created_at == live.current.created_at

    def open_browser(self, secret: str) -> str | None:
        """Make what a browser states from now on instead of a key; None where that is none.

        Of those of one key, and of all, the one that was opened first ends where there are too
        many.
        """
        session_secret = new_secret()
        now = self.now()
        with self._context().database.writing() as session:
            key = add_browser(
                session, digest_of(secret), digest_of(session_secret), now, now + BROWSER_LASTS
            )
        return None if key is None else session_secret

    def close_browser(self, secret: str) -> None:
        """Forget a browser."""
        digest = digest_of(secret)
        if digest in self._stored:
            with self._context().database.writing() as session:
                delete_browser(session, digest)

    def store_uses(self) -> None:
        """Tell the database when keys were used last."""
        there = {stored.key.id for stored in self._stored.values()}
        due = {
            number: time
            for number, time in self._used.copy().items()
            if number in there
            and time - self._stored_uses.get(number, datetime.min.replace(tzinfo=time.tzinfo))
            >= USE_NOTED_EVERY
        }
        if due:
            with self._context().database.writing(QUESTION) as session:
                note_uses(session, due)
            self._stored_uses |= due


class KeyFollower(Background):
    """Lets the keys in memory follow the database, by the clock alone.

    Neither requests nor what other processes tell are needed for it: on PostgreSQL the connection
    on which they tell may be cut, or dead without a word.

    Parameters
    ----------
    every_s
        How often the database is asked [s].
    """

    def __init__(self, ring: KeyRing, every_s: float) -> None:
        super().__init__("key-follower")
        self._ring = ring
        self._every_s = every_s

    def _run(self) -> None:
        self._repeat(
            self._look, self._every_s, "the keys could not follow the database", at_once=True
        )

    def _look(self) -> None:
        self._ring.refresh()
        self._ring.store_uses()
