"""News: what one process tells the others on the same PostgreSQL, at the moment of its commit.

News say what kind of thing changed and of which machine, never what it is now: whoever hears
them looks into the database. So news that are lost, or come twice, do no harm.
"""

from __future__ import annotations

from collections.abc import Collection
from enum import StrEnum
from typing import Final, NamedTuple

from sqlalchemy import text
from sqlalchemy.orm import Session

CHANNEL: Final = "thermap_news"
"""PostgreSQL's channel: one for each database, whatever else is in it."""

_PENDING: Final = "thermap_news"

_SEND: Final = text(
    "SELECT pg_notify(:channel, payload) FROM unnest(CAST(:payloads AS text[])) AS payload"
)


class NewsKind(StrEnum):
    """What has changed."""

    READINGS = "readings"
    """A machine has more readings."""
    MACHINE = "machine"
    """A machine came, went, or changed its settings, its active version, or what is withdrawn."""
    KEYS = "keys"
    """Keys or browsers were made or revoked."""
    LOG = "log"
    """The event log has a new entry, or one changed."""


class News(NamedTuple):
    """What has changed, and of which machine; "" where it is of none."""

    kind: NewsKind
    machine_id: str = ""


def tell(session: Session, kind: NewsKind, machine_id: str = "") -> None:
    """Note in a transaction what the others are told when it is committed, each thing once."""
    session.info.setdefault(_PENDING, {})[News(kind, machine_id)] = None


def send_pending(session: Session, sender: str) -> set[NewsKind]:
    """Hand what was noted to PostgreSQL, which tells it at the commit; nothing on SQLite.

    Returns
    -------
    set
        What kinds of things changed, on both.
    """
    pending: Collection[News] = session.info.pop(_PENDING, ())
    payloads = [f"{news.kind} {sender} {news.machine_id}" for news in pending]
    if payloads and session.get_bind().dialect.name == "postgresql":
        session.execute(_SEND, {"channel": CHANNEL, "payloads": payloads})
    return {news.kind for news in pending}


def told_of(kind: NewsKind, sender: str) -> dict[str, str]:
    """Give what a statement that tells news itself is handed; it puts the machine's id behind.

    >>> told_of(NewsKind.READINGS, "5f3a")["told"]
    'readings 5f3a '
    """
    return {"channel": CHANNEL, "told": f"{kind} {sender} "}


def read_payload(payload: str) -> tuple[News, str] | None:
    """Read what was told and by whom; None where somebody else told something else.

    >>> read_payload("readings 5f3a mcfv5050")
    (News(kind=<NewsKind.READINGS: 'readings'>, machine_id='mcfv5050'), '5f3a')
    >>> read_payload("hello") is None
    True
    """
    parts = payload.split(" ")
    if len(parts) != len(("kind", "sender", "machine")) or parts[0] not in list(NewsKind):
        return None
    return News(NewsKind(parts[0]), parts[2]), parts[1]
