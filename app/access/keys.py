"""Keys: who asks, what it may do, and on which machines."""

from __future__ import annotations

import hashlib
import re
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from typing import Final

from app.answer import Answer
from app.errors import InvalidContent

PREFIX: Final = "thermap_"
"""What every key begins with, so that a key that lies about somewhere is known as one."""

_SECRET_BYTES: Final = 32
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


class Role(StrEnum):
    """What a key is for."""

    SENSOR = "sensor"
    VIEWER = "viewer"
    METROLOGIST = "metrologist"
    ADMIN = "admin"

    def includes(self, other: Role) -> bool:
        """Whether a key of this role may do what the other is for.

        >>> Role.METROLOGIST.includes(Role.SENSOR), Role.VIEWER.includes(Role.SENSOR)
        (True, False)
        """
        return other in _INCLUDED[self]


_INCLUDED: Final[Mapping[Role, frozenset[Role]]] = {
    Role.SENSOR: frozenset({Role.SENSOR}),
    Role.VIEWER: frozenset({Role.VIEWER}),
    Role.METROLOGIST: frozenset({Role.SENSOR, Role.VIEWER, Role.METROLOGIST}),
    Role.ADMIN: frozenset(Role),
}


@dataclass(frozen=True, slots=True)
class AccessKey(Answer):
    """One key as it is listed; the key itself is known to nobody but its holder."""

    id: int
    """Number of the key"""
    name: str
    """Whose it is: a person, a computer, a sensor"""
    role: Role
    """What it may do"""
    machines: tuple[str, ...] | None
    """Ids of the machines that it is for; null for all, also those that are made later"""
    created_at: datetime
    """When it was made"""
    last_used_at: datetime | None
    """When it was used last, to the minute; null before its first use"""

    def sees(self, machine_id: str) -> bool:
        """Whether it is for this machine."""
        return self.machines is None or machine_id in self.machines


@dataclass(frozen=True, slots=True)
class NewAccessKey(Answer):
    """A key that was just made, with the key itself: it is shown this once."""

    key: AccessKey
    """The key as it is listed from now on"""
    secret: str
    """What its holder states as `Authorization: Bearer …`; it is stored nowhere"""


def new_secret() -> str:
    """Make a key that nobody can guess: 256 bits by chance."""
    return PREFIX + secrets.token_urlsafe(_SECRET_BYTES)


def digest_of(secret: str) -> str:
    """Write what is stored of a key: its SHA-256, in hexadecimal digits.

    One round is enough for 256 bits by chance: slow hashes are for what people choose. Who looks
    keys up by their digest compares nothing that takes longer the more of a guess is right.
    """
    return hashlib.sha256(secret.encode("utf-8", "surrogateescape")).hexdigest()


def checked_name(name: str) -> str:
    """Return the name of a key.

    Raises
    ------
    InvalidContent
        If it cannot be one.
    """
    if not _NAME.fullmatch(name):
        raise InvalidContent.of_field(
            "name",
            "expected 1 to 64 letters, digits, dots, hyphens and underscores that begin with a "
            f"letter or digit, got {name[:80]!r}",
        )
    return name
