"""What each process that has connections last told of them."""

from __future__ import annotations

from datetime import timedelta
from typing import NamedTuple

from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from app.storage.tables import ConnectionReportRow


class Report(NamedTuple):
    """A process' report, and how old it is by the database's clock."""

    content: str
    age: timedelta


def write_report(session: Session, owner: str, content: str, forget_after: timedelta) -> None:
    """Store a report in place of the owner's last; those of whom nothing came for long go."""
    now = session.scalar(select(func.now()))
    assert now is not None
    session.execute(
        delete(ConnectionReportRow).where(ConnectionReportRow.told_at < now - forget_after)
    )
    session.merge(ConnectionReportRow(owner=owner, told_at=now, content=content))


def delete_report(session: Session, owner: str) -> None:
    """Forget an owner."""
    session.execute(delete(ConnectionReportRow).where(ConnectionReportRow.owner == owner))


def reports(session: Session) -> dict[str, Report]:
    """Read all, by owner."""
    query = select(ConnectionReportRow, func.now()).order_by(ConnectionReportRow.owner)
    return {
        row.owner: Report(row.content, now - row.told_at) for row, now in session.execute(query)
    }
