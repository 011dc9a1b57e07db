"""Readings in the database."""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterable, Iterator, Mapping, Sequence, Set
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, NamedTuple

import orjson
from sqlalchemy import delete, func, insert, literal, or_, select
from sqlalchemy.dialects import sqlite
from sqlalchemy.orm import Session

from app.access.authorization import Authorization
from app.storage.access_keys import HOLD_KEYS, confirm_held, confirm_one
from app.storage.database import MOMENT, Database
from app.storage.machines import hold_machines
from app.storage.news import NewsKind, tell, told_of
from app.storage.tables import MachineRow, ReadingRow, WithdrawnReadingRow
from app.storage.temperature_hours import mark_stale
from app.thermal.reading import Reading

SEARCHED = 2000
"""Readings looked through for sensors that have not reported for long."""

LAST = 2
"""Values of each sensor that are read however old they are: a jump shows by the one before it."""

BATCH = 2000
"""Times a question: SQLite and PostgreSQL allow some 32,000 values in one."""

_ONE_TIME = ["machine_id", "time"]

_ADDED = (
    "added AS (INSERT INTO reading (machine_id, time, temperatures_c, state, early_s) "
    "SELECT * FROM json_to_recordset(CAST(%(document)s AS json)) AS stated (machine_id varchar, "
    "time timestamptz, temperatures_c json, state json, early_s double precision) {where} "
    "{unless_there} RETURNING id, machine_id, time), "
    "new AS (SELECT machine_id, array_agg(id) AS numbers, "
    "CASE WHEN sum(count(*)) OVER () < %(count)s THEN array_agg(time) END AS times "
    "FROM added GROUP BY machine_id)"
)
_UNLESS_THERE = "ON CONFLICT (machine_id, time) DO NOTHING"

_ADD = (
    f"WITH {_ADDED.format(where='', unless_there=_UNLESS_THERE)} "
    "SELECT machine_id, numbers, times FROM new"
)


def _hold_and_add(unless_there: str) -> str:
    """Hold machines, add their readings and tell the others, with one question and one answer."""
    where = "WHERE machine_id IN (SELECT id FROM held)"
    return (
        # Machines first, as everywhere, and by id. KEY SHARE collides with FOR UPDATE alone, which
        # only those take who delete a machine: these are skipped. Readings are inserted for those
        # machines only that are locked by now, and others are told of those only that got some.
        "WITH held AS MATERIALIZED (SELECT id, created_at, revision, withdrawals FROM machine "
        "WHERE id = ANY(%(ids)s) ORDER BY id FOR KEY SHARE SKIP LOCKED), "
        f"{_ADDED.format(where=where, unless_there=unless_there)} "
        "SELECT held.*, numbers, times, "
        "CASE WHEN numbers IS NOT NULL THEN pg_notify(%(channel)s, %(told)s || id) END "
        "FROM held LEFT JOIN new ON machine_id = id"
    )


_HOLD_AND_ADD = _hold_and_add(_UNLESS_THERE)
_HOLD_AND_ADD_NEW = _hold_and_add("")
"""Without looking first whether they are there, which takes a sixth of the server's time."""


class NumberedReading(NamedTuple):
    """A reading with its number, its machine, and how often that had had some withdrawn."""

    number: int
    machine_id: str
    withdrawals: int
    reading: Reading


@dataclass(frozen=True, slots=True, kw_only=True)
class WithdrawnReading(Reading, published_as="WithdrawnReadingAnswer", whole=False):
    """A reading that was withdrawn: it counts nowhere."""

    withdrawn_at: datetime
    """When it was withdrawn, UTC"""


class AddedReadings(NamedTuple):
    """Readings that were not there before: their times, and the numbers that they were given.

    `are_all` says that none of those that were to be added was there.
    """

    times: Set[datetime]
    numbers: list[int]
    are_all: bool = False


_NOTHING = AddedReadings(frozenset(), [])


class HeldMachine(NamedTuple):
    """A machine's shape as it is as long as the transaction lasts, and what was added to it."""

    created_at: datetime
    revision: int
    withdrawals: int
    added: AddedReadings


def insert_readings(
    session: Session, readings: Mapping[str, Sequence[Reading]]
) -> dict[str, AddedReadings]:
    """Add readings, each time once, whose times are not there yet.

    Parameters
    ----------
    readings
        By machine; what is returned is too, with nothing added for some.
    """
    if not any(readings.values()):
        return dict.fromkeys(readings, _NOTHING)
    if session.get_bind().dialect.name == "sqlite":
        added = _insert_one_by_one(session, readings)
    else:
        rows = session.connection().exec_driver_sql(_ADD, _parameters(readings)).all()
        new = {machine_id: (numbers, times) for machine_id, numbers, times in rows}
        added = {m: _added(readings[m], *new.get(m, (None, None))) for m in readings}
    for machine_id, came in added.items():
        if came.numbers:
            tell(session, NewsKind.READINGS, machine_id)
    return added


@contextmanager
def readings_inserted(
    database: Database,
    readings: Mapping[str, Sequence[Reading]],
    asked_by: Collection[Authorization] = (),
    *,
    are_new: bool = False,
) -> Iterator[dict[str, HeldMachine]]:
    """Do the same for many machines in a transaction of its own, which waits for nobody long.

    It is committed at the end, or rolled back whole. Machines that are not there, or that somebody
    is deleting, get nothing, and are left out of what is given.

    Parameters
    ----------
    asked_by
        Those who want it, by their keys.
    are_new
        Whether all of them should be new, as far as one knows.

    Raises
    ------
    AccessRefused
        If one of the keys may not do it any more: then nothing is added.
    sqlalchemy.exc.IntegrityError
        If one of those that should be new was there: then nothing is added.
    """
    if database.is_sqlite:
        # All writers share one lock: who waits for it waits alone.
        with database.writing(MOMENT) as session:
            rows = hold_machines(session, readings)
            added = insert_readings(session, {m: readings[m] for m in rows})
            for authorization in asked_by:
                confirm_one(session, authorization, locked=True)
            yield {
                m: HeldMachine(row.created_at, row.revision, row.withdrawals, added[m])
                for m, row in rows.items()
            }
        return
    parameters = _parameters(readings) | told_of(NewsKind.READINGS, database.sender)
    with database.appending() as connection:
        answer_rows = connection.execute(
            _HOLD_AND_ADD_NEW if are_new else _HOLD_AND_ADD, parameters
        ).fetchall()
        if asked_by:
            digests = {"digests": sorted({asker.digest for asker in asked_by})}
            # Keys after machines, as in every transaction: those who revoke keys lock the machines
            # first, too.
            confirm_held(asked_by, connection.execute(HOLD_KEYS, digests))
        yield {
            m: HeldMachine(born, revision, withdrawals, _added(readings[m], numbers, times))
            for m, born, revision, withdrawals, numbers, times, _ in answer_rows
        }


def _insert_one_by_one(
    session: Session, readings: Mapping[str, Sequence[Reading]]
) -> dict[str, AddedReadings]:
    statement = (
        sqlite.insert(ReadingRow)
        .on_conflict_do_nothing(index_elements=_ONE_TIME)
        .returning(ReadingRow.machine_id, ReadingRow.time, ReadingRow.id)
    )
    rows = [
        _row(m, reading)
        | {"temperatures_c": dict(reading.temperatures_c), "state": dict(reading.state)}
        for m in sorted(readings)
        for reading in readings[m]
    ]
    new: dict[str, dict[datetime, int]] = {machine_id: {} for machine_id in readings}
    # On the connection rather than the session: one statement for many rows, written once.
    for machine_id, time, number in session.connection().execute(statement, rows):
        new[machine_id][time] = number
    return {
        m: AddedReadings(numbers.keys(), [*numbers.values()], len(numbers) == len(readings[m]))
        for m, numbers in new.items()
    }


def _parameters(readings: Mapping[str, Sequence[Reading]]) -> dict[str, Any]:
    """Write what the statements on PostgreSQL are handed: all rows in one JSON document.

    To write values, or arrays of them, costs this end three times as much. Which times are new
    is answered only where not all of them are.
    """
    ids = sorted(readings)
    rows = [_row(m, reading) for m in ids for reading in readings[m]]
    document = orjson.dumps(rows, default=dict).decode()
    return {"ids": ids, "document": document, "count": len(rows)}


def _added(
    readings: Sequence[Reading], numbers: list[int] | None, times: list[datetime] | None
) -> AddedReadings:
    if numbers is None:
        return _NOTHING
    if times is None:
        return AddedReadings({reading.time for reading in readings}, numbers, are_all=True)
    return AddedReadings(set(times), numbers, len(times) == len(readings))


def _row(machine_id: str, reading: Reading) -> dict[str, Any]:
    return {
        "machine_id": machine_id,
        "time": reading.time,
        "temperatures_c": reading.temperatures_c,
        "state": reading.state,
        "early_s": reading.early_s or None,
    }


def find_readings(
    session: Session, machine_id: str, times: Sequence[datetime]
) -> dict[datetime, Reading]:
    """Find readings by their exact times."""
    by_time: dict[datetime, Reading] = {}
    for start in range(0, len(times), BATCH):
        query = select(ReadingRow).where(
            ReadingRow.machine_id == machine_id,
            ReadingRow.time.in_(times[start : start + BATCH]),
        )
        by_time.update((row.time, _reading(row)) for row in session.scalars(query))
    return by_time


def list_readings(
    session: Session,
    machine_id: str,
    since: datetime | None = None,
    until: datetime | None = None,
) -> Generator[Reading, None, None]:
    """Go through a machine's readings in order of time, both ends included.

    Whoever stops before the end closes it.
    """
    query = select(ReadingRow).where(ReadingRow.machine_id == machine_id)
    if since is not None:
        query = query.where(ReadingRow.time >= since)
    if until is not None:
        query = query.where(ReadingRow.time <= until)
    ordered = query.order_by(ReadingRow.time).execution_options(yield_per=1000)
    with session.scalars(ordered) as rows:
        for row in rows:
            yield _reading(row)


def list_withdrawn(
    session: Session,
    machine_id: str,
    since: datetime | None,
    until: datetime | None,
    limit: int,
) -> list[WithdrawnReading]:
    """List a machine's readings that were withdrawn, in order of time, both ends included.

    Of several of one time the one that was stored first comes first.
    """
    query = select(WithdrawnReadingRow).where(WithdrawnReadingRow.machine_id == machine_id)
    if since is not None:
        query = query.where(WithdrawnReadingRow.time >= since)
    if until is not None:
        query = query.where(WithdrawnReadingRow.time <= until)
    ordered = query.order_by(WithdrawnReadingRow.time, WithdrawnReadingRow.id).limit(limit)
    return [
        WithdrawnReading(row.time, row.temperatures_c, row.state, withdrawn_at=row.withdrawn_at)
        for row in session.scalars(ordered)
    ]


def recent_readings(
    session: Session,
    machine_id: str,
    until: datetime,
    window: timedelta,
    sensors: Iterable[str],
) -> list[Reading]:
    """List the newest readings up to a time, oldest first.

    They go back over a window before the newest one, and, for the last `LAST` values of
    sensors of which those have fewer, over at most `SEARCHED` more.
    """
    query = (
        select(ReadingRow)
        .where(ReadingRow.machine_id == machine_id, ReadingRow.time <= until)
        .order_by(ReadingRow.time.desc())
        .execution_options(yield_per=1000)
    )
    recent: list[Reading] = []
    unseen = dict.fromkeys(sensors, LAST)
    beyond = 0
    with session.scalars(query) as rows:
        for row in rows:
            reading = _reading(row)
            if recent and recent[0].time - reading.time > window:
                beyond += 1
                if not unseen or beyond > SEARCHED:
                    break
                if unseen.keys().isdisjoint(reading.temperatures_c):
                    continue
            recent.append(reading)
            for name in unseen.keys() & reading.temperatures_c.keys():
                unseen[name] -= 1
                if not unseen[name]:
                    del unseen[name]
    return recent[::-1]


def readings_after(session: Session, machine_id: str, time: datetime, limit: int) -> list[Reading]:
    """List the first readings after a time, in order of time."""
    query = (
        select(ReadingRow)
        .where(ReadingRow.machine_id == machine_id, ReadingRow.time > time)
        .order_by(ReadingRow.time)
        .limit(limit)
    )
    return [_reading(row) for row in session.scalars(query)]


def newest_readings(
    session: Session, machine_id: str, until: datetime, limit: int
) -> list[Reading]:
    """List the last readings up to a time, in order of time."""
    query = (
        select(ReadingRow)
        .where(ReadingRow.machine_id == machine_id, ReadingRow.time <= until)
        .order_by(ReadingRow.time.desc())
        .limit(limit)
    )
    return [_reading(row) for row in session.scalars(query)][::-1]


def oldest_time(session: Session, machine_id: str) -> datetime | None:
    """Give the time of a machine's oldest reading, None where there is none."""
    query = (
        select(ReadingRow.time)
        .where(ReadingRow.machine_id == machine_id)
        .order_by(ReadingRow.time)
        .limit(1)
    )
    return session.scalar(query)


def newest_time(session: Session, machine_id: str, until: datetime) -> datetime | None:
    """Give the time of a machine's newest reading up to a time, None where there is none."""
    query = (
        select(ReadingRow.time)
        .where(ReadingRow.machine_id == machine_id, ReadingRow.time <= until)
        .order_by(ReadingRow.time.desc())
        .limit(1)
    )
    return session.scalar(query)


def withdraw_stored(
    session: Session, machine: MachineRow, since: datetime, until: datetime, now: datetime
) -> int:
    """Take a locked machine's readings between two times, both included, out of use.

    They move to a table of their own; how many is returned.
    """
    identity = (ReadingRow.id, ReadingRow.machine_id, ReadingRow.time)
    content = (ReadingRow.temperatures_c, ReadingRow.state)
    between = (ReadingRow.machine_id == machine.id, ReadingRow.time.between(since, until))
    at = literal(now, WithdrawnReadingRow.withdrawn_at.type)
    names = [column.key for column in (*identity, *content)]
    moved = select(*identity, *content, at).where(*between)
    session.connection().execute(
        insert(WithdrawnReadingRow).from_select([*names, "withdrawn_at"], moved)
    )
    # Those that were copied, and none that came in between: no number is used twice.
    copied = select(WithdrawnReadingRow.id).where(WithdrawnReadingRow.machine_id == machine.id)
    gone = session.connection().execute(
        delete(ReadingRow).where(*between, ReadingRow.id.in_(copied))
    )
    count = gone.rowcount
    if count:
        mark_stale(session, machine.id, since, until)
        machine.withdrawals += 1
        tell(session, NewsKind.MACHINE, machine.id)
    return count


def delete_some_readings(session: Session, machine_id: str, before: datetime, most: int) -> int:
    """Delete the oldest readings of a machine before a time, at most so many; say how many."""
    oldest = (
        select(ReadingRow.time)
        .where(ReadingRow.machine_id == machine_id, ReadingRow.time < before)
        .order_by(ReadingRow.time)
        .limit(most)
    )
    times = list(session.scalars(oldest))
    if not times:
        return 0
    # By a range of times: DELETE has no LIMIT in PostgreSQL, nor in most builds of SQLite.
    gone = session.connection().execute(
        delete(ReadingRow).where(
            ReadingRow.machine_id == machine_id, ReadingRow.time.between(times[0], times[-1])
        )
    )
    return gone.rowcount


def delete_readings_at(session: Session, machine_id: str, times: Sequence[datetime]) -> None:
    """Delete a machine's readings of exact times."""
    for start in range(0, len(times), BATCH):
        session.connection().execute(
            delete(ReadingRow).where(
                ReadingRow.machine_id == machine_id,
                ReadingRow.time.in_(times[start : start + BATCH]),
            )
        )


def newest_id(session: Session) -> int:
    """Give the number of the reading stored last, of any machine; 0 before the first."""
    return session.scalar(select(func.max(ReadingRow.id))) or 0


def numbered_readings(
    session: Session, above: int, gaps: Iterable[tuple[int, int]]
) -> list[NumberedReading]:
    """List readings with a number above this one or in a gap (first, last)."""
    wanted = or_(ReadingRow.id > above, *(ReadingRow.id.between(*gap) for gap in gaps))
    # With the withdrawals in one statement: they say of which readings this is the whole.
    query = select(ReadingRow, MachineRow.withdrawals).join(MachineRow).where(wanted)
    return [
        NumberedReading(row.id, row.machine_id, withdrawals, _reading(row))
        for row, withdrawals in session.execute(query)
    ]


def _reading(row: ReadingRow) -> Reading:
    return Reading(row.time, row.temperatures_c, row.state, row.early_s or 0.0)
