"""Readings by months, on PostgreSQL: made ahead, and dropped whole when their time is over.

What lies in no month that was made goes into a partition of its own (`reading_default`), so that
nothing is refused; a month that is made later takes its readings out of there.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from typing import Final

from sqlalchemy import Connection, text

AHEAD: Final = 2
"""Months after the present one that are made."""

_NAME: Final = re.compile(r"reading_(\d{4})m(\d{2})")

_PARTITIONS: Final = text(
    "SELECT child.relname FROM pg_inherits "
    "JOIN pg_class child ON child.oid = inhrelid "
    "WHERE inhparent = 'reading'::regclass ORDER BY child.relname"
)

_LOCKS: Final = "LOCK TABLE machine IN SHARE ROW EXCLUSIVE MODE"
"""Machines before anything else, as all who write do: else two could wait for each other."""


def months_made(connection: Connection) -> list[datetime]:
    """List the months that have a partition, by their beginning."""
    matches = [_NAME.fullmatch(name) for name in connection.scalars(_PARTITIONS)]
    return [datetime(int(m[1]), int(m[2]), 1, tzinfo=UTC) for m in matches if m is not None]


def make_months(connection: Connection, now: datetime) -> list[datetime]:
    """Make the present month and those after it; return the ones that were not there."""
    month = now.astimezone(UTC).replace(day=1, hour=0, minute=0, second=0, microsecond=0)
    wanted = [month]
    for _ in range(AHEAD):
        wanted.append(month_after(wanted[-1]))
    there = months_made(connection)
    new = [month for month in wanted if month not in there]
    if new:
        connection.exec_driver_sql(_LOCKS)
        there = months_made(connection)  # somebody else may have made them meanwhile
        new = [month for month in new if month not in there]
    for month in new:
        _make(connection, month)
    return new


def drop_months(connection: Connection, before: datetime) -> list[datetime]:
    """Drop the months that end before a time, with their readings; return them."""
    over = [month for month in months_made(connection) if month_after(month) <= before]
    if over:
        connection.exec_driver_sql(_LOCKS)
    for month in over:
        connection.exec_driver_sql(f"DROP TABLE IF EXISTS {_name(month)}")
    return over


def month_after(month: datetime) -> datetime:
    """Give the beginning of the next month.

    >>> month_after(datetime(2026, 12, 1, tzinfo=UTC)).isoformat()
    '2027-01-01T00:00:00+00:00'
    """
    return month.replace(year=month.year + month.month // 12, month=month.month % 12 + 1)


def _name(month: datetime) -> str:
    return f"reading_{month:%Y}m{month:%m}"


def _make(connection: Connection, month: datetime) -> None:
    """Make a month, and take what is already there of it out of the default partition."""
    name, first, last = _name(month), month.isoformat(), month_after(month).isoformat()
    # ATTACH refuses a month of which the default partition has readings: they are moved first, and
    # none may come in between.
    connection.exec_driver_sql("LOCK TABLE reading IN ACCESS EXCLUSIVE MODE")
    connection.exec_driver_sql(f"CREATE TABLE {name} (LIKE reading INCLUDING DEFAULTS)")
    connection.exec_driver_sql(
        "WITH moved AS (DELETE FROM reading_default "
        f"WHERE time >= '{first}' AND time < '{last}' RETURNING *) "
        f"INSERT INTO {name} SELECT * FROM moved"
    )
    connection.exec_driver_sql(
        f"ALTER TABLE reading ATTACH PARTITION {name} FOR VALUES FROM ('{first}') TO ('{last}')"
    )
