"""Who is told of alarms, and what was told."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import asdict, dataclass, field
from datetime import datetime, timedelta

from pydantic import TypeAdapter
from sqlalchemy import delete, select, update
from sqlalchemy.orm import Session

from app.storage.tables import ReceiverRow


@dataclass(frozen=True, slots=True)
class Announced:
    """The alarms of a machine that a receiver knows of.

    Parameters
    ----------
    alarms
        Ids of their entries in the event log.
    since
        When the first of them came.
    at
        When the receiver was last told of them.
    """

    alarms: tuple[int, ...]
    since: datetime
    at: datetime


_ANNOUNCED = TypeAdapter(dict[str, Announced])


@dataclass(frozen=True, slots=True)
class StoredReceiver:
    """A receiver as it is stored (`ReceiverRow`)."""

    name: str
    service: str
    machines: tuple[str, ...]
    settled: int
    looked_at: datetime
    announced: dict[str, Announced] = field(default_factory=dict)
    waiting: tuple[str, ...] = ()
    sent_at: datetime | None = None
    sent: str = ""
    failing_since: datetime | None = None
    failure: str = ""
    test_asked_at: datetime | None = None
    tested_at: datetime | None = None
    test_failure: str = ""

    @property
    def is_test_due(self) -> bool:
        """Whether a test message was asked for and not sent yet."""
        requested_at, tested = self.test_asked_at, self.tested_at
        return requested_at is not None and (tested is None or tested < requested_at)


def stored_receivers(session: Session) -> dict[str, StoredReceiver]:
    """Read all receivers, by name."""
    return {
        row.name: StoredReceiver(
            row.name,
            row.service,
            tuple(row.machines),
            row.settled,
            row.looked_at,
            _ANNOUNCED.validate_python(row.announced),
            tuple(row.waiting),
            row.sent_at,
            row.sent,
            row.failing_since,
            row.failure,
            row.test_asked_at,
            row.tested_at,
            row.test_failure,
        )
        for row in session.scalars(select(ReceiverRow).order_by(ReceiverRow.name))
    }


def write_receiver(session: Session, receiver: StoredReceiver) -> None:
    """Store all of a receiver but whether somebody asks for a test of it."""
    fields = asdict(receiver) | {
        "announced": _ANNOUNCED.dump_python(receiver.announced, mode="json"),
        "machines": list(receiver.machines),
        "waiting": list(receiver.waiting),
    }
    del fields["test_asked_at"]
    session.merge(ReceiverRow(**fields))


def forget_receivers(
    session: Session, but: Collection[str], now: datetime, silent_for: timedelta
) -> None:
    """Forget receivers that nobody has any more."""
    session.execute(
        delete(ReceiverRow).where(
            ReceiverRow.name.not_in(but), ReceiverRow.looked_at < now - silent_for
        )
    )


def ask_for_test(session: Session, name: str, now: datetime) -> None:
    """Note that a receiver is to be sent a test message."""
    session.execute(update(ReceiverRow).where(ReceiverRow.name == name).values(test_asked_at=now))
