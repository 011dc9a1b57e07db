"""The event log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, Final, NamedTuple

from sqlalchemy import and_, delete, false, func, literal_column, or_, select
from sqlalchemy.orm import Session

from app.access.authorization import key_asking
from app.events.event import PASSING, SERVICE, Event, EventKind, acting
from app.status.judge import Logged
from app.storage.log_numbers import note_entry
from app.storage.tables import EventRow, MachineRow

COMES_AGAIN_WITHIN: Final = timedelta(minutes=10)
"""What comes again so soon after it went is the same row, counted."""

_LASTS: Final = (EventRow.until.is_(None), EventRow.subject != literal_column("''"))
"""What has come and not gone; changes have no subject. SQLite finds the index that holds these
rows alone only where the empty text is written out."""

ALARMS_KEPT: Final = timedelta(days=90)
"""Alarms and failures of sensors that went longer ago are deleted; changes are kept for ever."""

MOST_ALTERNATING: Final = 8
"""Of as many entries of one subject an alarm may be one that came back: more than a sensor has ways
to fail, between which it may go to and fro."""


def write_event(
    session: Session,
    machine_id: str | None,
    kind: EventKind,
    text: str,
    now: datetime,
    details: Mapping[str, Any] | None = None,
) -> None:
    """Write that something was changed, in the transaction that changes it."""
    _add(session, _new(machine_id, kind, "", str(acting.get()), text, now, details or {}))


def begin_passing(
    session: Session,
    machine_id: str,
    kind: EventKind,
    subject: str,
    text: str,
    now: datetime,
    details: Mapping[str, Any],
) -> None:
    """Write that an alarm came, unless that is written already; one that came back is counted.

    Of one subject what has other details is another alarm, and goes as this one comes.
    """
    query = (
        select(EventRow)
        .where(
            EventRow.machine_id == machine_id,
            EventRow.kind == str(kind),
            EventRow.subject == subject,
            # Not one of an older machine; what this transaction wrote has no number yet.
            or_(EventRow.number.is_(None), EventRow.number > _entries_after(machine_id)),
        )
        .order_by(EventRow.id.desc())
        .limit(MOST_ALTERNATING)
    )
    # What comes of an alarm of this subject:
    #
    #     the log has one with these details that ...     then
    #       lasts                                         nothing is written
    #       went within COMES_AGAIN_WITHIN                it lasts again, and is counted
    #       went before that, or there is none            a new entry
    #
    # One with other details that lasts ends in all three.
    earlier = list(session.scalars(query))
    for row in earlier:
        if row.until is None and row.details != details:
            _end(session, row, now)
    last = next((row for row in earlier if row.details == details), None)
    if last is not None and last.until is None:
        return
    if last is not None and last.until is not None and now - last.until <= COMES_AGAIN_WITHIN:
        last.until = None
        last.count += 1
        note_entry(session, last)
        return
    _add(session, _new(machine_id, kind, subject, SERVICE, text, now, details))


def end_passing(
    session: Session, machine_id: str, kind: EventKind, still: Collection[str], now: datetime
) -> None:
    """Write that all alarms of a kind have gone but those of these subjects."""
    for row in session.scalars(_lasting(machine_id, kind)):
        if row.subject not in still:
            _end(session, row, now)


def end_all_passing(session: Session, machine_id: str, now: datetime) -> None:
    """Write that nothing lasts any more of a machine that goes."""
    for kind in PASSING:
        end_passing(session, machine_id, kind, (), now)


def lasting_details(session: Session) -> dict[tuple[str, EventKind], dict[str, dict[str, Any]]]:
    """Give what has come and not gone, by machine and kind: each subject with its details."""
    details: dict[tuple[str, EventKind], dict[str, dict[str, Any]]] = {}
    for row in session.scalars(select(EventRow).where(*_LASTS)):
        if row.machine_id is not None:
            details.setdefault((row.machine_id, EventKind(row.kind)), {})[row.subject] = row.details
    return details


def lasting_since(session: Session) -> dict[str, Logged]:
    """Say of each machine since when its alarms and failures last, where that is known.

    Of what went and came back within ten minutes the log has when it came first, and how often:
    since when it lasts now is not known.
    """
    columns = (EventRow.machine_id, EventRow.kind, EventRow.subject, EventRow.time)
    since: dict[str, tuple[dict[str, datetime], dict[str, datetime]]] = {}
    for machine_id, kind, subject, time in session.execute(
        select(*columns).where(*_LASTS, EventRow.count == 1)
    ):
        if machine_id is not None:
            states, sensors = since.setdefault(machine_id, ({}, {}))
            (states if kind == EventKind.ALARM else sensors)[subject] = time
    return {machine_id: Logged(*times) for machine_id, times in since.items()}


def lasting_events(session: Session) -> list[Event]:
    """List what has come and not gone, of all machines, the oldest first."""
    query = select(EventRow).where(*_LASTS).order_by(EventRow.id)
    return [_event(row) for row in session.scalars(query)]


class NumberedAlarm(NamedTuple):
    """An alarm, and the number that its entry has now."""

    number: int
    event: Event


def alarms_since(session: Session, number: int, ids: Collection[int]) -> list[NumberedAlarm]:
    """List alarms that last, those whose entry has a larger number, and some by their id."""
    of_interest = or_(EventRow.number > number, EventRow.id.in_(ids))
    alarms: dict[int, NumberedAlarm] = {}
    for condition in (and_(*_LASTS), of_interest):
        query = select(EventRow).where(condition, EventRow.kind == str(EventKind.ALARM))
        for row in session.scalars(query):
            alarms[row.id] = NumberedAlarm(row.number or 0, _event(row))
    return [alarms[i] for i in sorted(alarms)]


def newest_number(session: Session) -> int:
    """Give the largest number that an entry of the log has, 0 without any."""
    return session.scalar(select(func.max(EventRow.number))) or 0


def delete_old_alarms(session: Session, now: datetime) -> None:
    """Delete alarms and sensors' failures that went long ago.

    Numbers go on from the last one: its entry stays until there is a later one.
    """
    kinds = [str(kind) for kind in PASSING]
    last = select(func.max(EventRow.number)).scalar_subquery()
    session.execute(
        delete(EventRow).where(
            EventRow.until < now - ALARMS_KEPT, EventRow.kind.in_(kinds), EventRow.number < last
        )
    )


@dataclass(frozen=True, slots=True)
class LogTail:
    """The end of the log as it is, each entry with its number, the oldest first.

    Between `after` and the first of them there is none that is left out; `newest` is the number
    of the last one of all, 0 in an empty log.
    """

    entries: Sequence[tuple[int, Event]]
    after: int
    newest: int


def read_tail(session: Session, after: int | None, most: int) -> LogTail:
    """Read what was written into the log after a number, the last `most` of it.

    Parameters
    ----------
    after
        The number; None for the last ones there are.
    """
    # First: what is committed between the two is then read, and not passed over as known.
    newest = session.scalar(select(func.max(EventRow.number))) or 0
    query = select(EventRow).where(EventRow.number.is_not(None))
    if after is not None:
        query = query.where(EventRow.number > after)
    rows = list(session.scalars(query.order_by(EventRow.number.desc()).limit(most)))
    entries = [(row.number or 0, _event(row)) for row in reversed(rows)]
    # Just so many may be all that there are: `begins` then claims less than it could, never more.
    is_cut = len(rows) == most
    begins = entries[0][0] - 1 if is_cut else after or 0
    return LogTail(entries, begins, entries[-1][0] if entries else newest)


def count_entries(
    session: Session, after: int, until: int
) -> Counter[tuple[str | None, EventKind, bool]]:
    """Count the entries with numbers above one and up to another.

    By machine, kind, and whether they are of the machine that has this id now.
    """
    is_present = func.coalesce(EventRow.number > MachineRow.entries_after, false())
    columns = (EventRow.machine_id, EventRow.kind, is_present)
    query = (
        select(*columns, func.count())
        .join(MachineRow, EventRow.machine_id == MachineRow.id, isouter=True)
        .where(EventRow.number > after, EventRow.number <= until)
        .group_by(*columns)
    )
    counted: Counter[tuple[str | None, EventKind, bool]] = Counter()
    for machine_id, kind, present, count in session.execute(query):
        counted[machine_id, EventKind(kind), bool(present)] = count
    return counted


def list_events(
    session: Session,
    machine_id: str | None,
    *,
    since: datetime | None = None,
    until: datetime | None = None,
    kinds: Collection[EventKind] = (),
    before: int | None = None,
    limit: int = 100,
) -> list[Event]:
    """List events, the newest first.

    A key for some machines is shown what happened to these, and nothing of older ones of their ids.

    Parameters
    ----------
    machine_id
        Of this machine; None for all.
    kinds
        Of these kinds; none for all.
    before
        Only those with a smaller number.
    """
    query = select(EventRow).order_by(EventRow.id.desc()).limit(limit)
    if machine_id is not None:
        query = query.where(EventRow.machine_id == machine_id)
    key = key_asking()
    if key is not None and key.machines is not None:
        query = query.join(MachineRow, EventRow.machine_id == MachineRow.id).where(
            MachineRow.id.in_(key.machines), EventRow.number > MachineRow.entries_after
        )
    if since is not None:
        query = query.where(EventRow.time >= since)
    if until is not None:
        query = query.where(EventRow.time <= until)
    if kinds:
        query = query.where(EventRow.kind.in_([str(kind) for kind in kinds]))
    if before is not None:
        query = query.where(EventRow.id < before)
    return [_event(row) for row in session.scalars(query)]


def _entries_after(machine_id: str) -> Any:
    """Say where the log of the machine begins that has this id now."""
    of_it = select(MachineRow.entries_after).where(MachineRow.id == machine_id)
    return func.coalesce(of_it.scalar_subquery(), 0)


def _lasting(machine_id: str, kind: EventKind) -> Any:
    return select(EventRow).where(
        *_LASTS, EventRow.machine_id == machine_id, EventRow.kind == str(kind)
    )


def _end(session: Session, row: EventRow, now: datetime) -> None:
    row.until = max(now, row.time)  # the clock may have gone back meanwhile
    note_entry(session, row)


def _add(session: Session, row: EventRow) -> None:
    session.add(row)
    note_entry(session, row)


def _new(
    machine_id: str | None,
    kind: EventKind,
    subject: str,
    who: str,
    text: str,
    now: datetime,
    details: Mapping[str, Any],
) -> EventRow:
    return EventRow(
        time=now,
        kind=str(kind),
        subject=subject,
        machine_id=machine_id,
        who=who,
        text=text,
        details=dict(details),
        until=None,
        count=1,
    )


def _event(row: EventRow) -> Event:
    return Event(
        id=row.id,
        time=row.time,
        kind=EventKind(row.kind),
        who=row.who,
        machine=row.machine_id,
        text=row.text,
        details=row.details,
        until=row.until,
        count=row.count,
    )
