"""Whether a request may do what it asks: decided when it comes, and again wherever it acts.

A key can be revoked while a body is still on its way, while a request waits for its turn, and
between two events of a stream. So what a request needs is looked at again, with the key as it is
then, after the body, in each transaction and at each event.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from datetime import datetime

from app.access.keys import AccessKey, Role
from app.errors import Conflict, KeyUnknown, NotAllowed


@dataclass(frozen=True, slots=True)
class Requirement:
    """What a request needs of a key.

    Parameters
    ----------
    machine
        Id of the machine that it is about; None where it is about none, or about several.
    all_machines
        Whether it is about all machines at once, and cannot be answered in part.
    """

    role: Role
    machine: str | None = None
    all_machines: bool = False

    def check(self, key: AccessKey | None) -> None:
        """Refuse what a key may not do.

        Raises
        ------
        KeyUnknown
            If there is no key.
        NotAllowed
            If its role is not enough, or it is not for the machine.
        """
        if key is None:
            raise KeyUnknown
        if self.role is not Role.SENSOR and key.role is Role.SENSOR:
            raise NotAllowed(f"the key {key.name!r} is for sending readings only")
        if not key.role.includes(self.role):
            raise NotAllowed(f"expected a key of the role {self.role}, got one of {key.role}")
        if self.machine is not None and not key.sees(self.machine):
            raise NotAllowed(f"the key {key.name!r} is not for the machine {self.machine[:80]!r}")
        if self.all_machines and key.machines is not None:
            raise NotAllowed("expected a key for all machines, got one for some")


@dataclass(frozen=True, slots=True)
class Authorization:
    """By what a request was let in.

    Parameters
    ----------
    digest
        Of the key that was stated, or of the browser's session.
    key
        As it was when the request came.
    expires_at
        When the session ends; None for a key, which does not.
    """

    digest: str
    key: AccessKey
    requirement: Requirement
    expires_at: datetime | None
    now: Callable[[], datetime]

    @property
    def is_expired(self) -> bool:
        """Whether the session's time is over."""
        return self.expires_at is not None and self.expires_at <= self.now()

    def confirm(self, key: AccessKey | None) -> None:
        """Refuse the request unless its key may still do the same.

        Parameters
        ----------
        key
            As it is now; None where there is none any more.

        Raises
        ------
        KeyUnknown, NotAllowed
            If it may not.
        Conflict
            If an answer about several machines was being made for others than the key is for now.
        """
        self.requirement.check(None if self.is_expired else key)
        machines = self.key.machines if key is None else key.machines
        if self.requirement.machine is None and machines != self.key.machines:
            raise Conflict(
                "which machines the key is for changed while this was answered; ask again"
            )


asking: ContextVar[Authorization | None] = ContextVar("asking", default=None)
"""By what the request was let in that is being answered; None where no key is asked for."""


@contextmanager
def as_service() -> Iterator[None]:
    """Do something for the service itself, whoever's request brought it about.

    What several requests share must not depend on the key of the one that came first.
    """
    before = asking.set(None)
    try:
        yield
    finally:
        asking.reset(before)


def key_asking() -> AccessKey | None:
    """Give the key of the request that is answered; None where none is asked for."""
    authorization = asking.get()
    return None if authorization is None else authorization.key


def may_write() -> bool:
    """Whether who asks may change anything, so that a page offers nobody what is refused him."""
    key = key_asking()
    return key is None or key.role.includes(Role.METROLOGIST)


def may_make_machines() -> bool:
    """Whether who asks may make machines and change what describes them."""
    key = key_asking()
    return key is None or key.role.includes(Role.ADMIN)
