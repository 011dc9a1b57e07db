"""Readings: store them, once each, and take those out of use that never should have been."""

from __future__ import annotations

import asyncio
from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from itertools import chain
from operator import attrgetter, lt
from typing import Final

from sqlalchemy.exc import IntegrityError

from app.access.authorization import Authorization, as_service, asking
from app.answer import Answer
from app.errors import (
    AccessRefused,
    Conflict,
    FieldError,
    InvalidContent,
    StorageBusy,
    StorageOvertaken,
    StorageUnavailable,
    UnknownThing,
    counted,
)
from app.events.event import EventKind
from app.live.registry import Arrived, LiveModel
from app.services.context import CLOCKS_DIFFER, Context, repeated
from app.services.live_table import ahead_warnings, old_warnings
from app.services.load_machine import load_machine, restore_past
from app.services.together import Wanted
from app.storage.events import write_event
from app.storage.machines import RowLock, find_machine, stored_machine
from app.storage.readings import (
    AddedReadings,
    HeldMachine,
    find_readings,
    insert_readings,
    readings_inserted,
    withdraw_stored,
)
from app.thermal.machine import Machine
from app.thermal.reading import Reading
from app.thermal.sensor_health import are_in_range, check_temperatures
from app.units import exact_time

MOST_AHEAD_OF_CLOCK: Final = timedelta(days=1)
"""Wrong clocks and zones put a reading less far ahead; what lies further is refused."""

LONG_AGO: Final = timedelta(days=3652)
"""Ten years: a reading that is older was rather stamped by a clock that had lost the time than
recorded so long ago. It is stored, because it may have been, and named."""

_time: Final = attrgetter("time")


@dataclass(frozen=True, slots=True)
class StoreOutcome(Answer, published_as="StoredReadings", whole=False):
    """What became of the readings."""

    stored: int
    """Readings that are new"""
    duplicates: int
    """Readings that were there already, with the same content"""
    ahead: int = 0
    """How many of them lie in the future and are not used before their time; left out where none
    does"""
    warnings: tuple[str, ...] = ()
    """What is to be said of them, in sentences; left out where nothing is"""


@dataclass(eq=False, slots=True)
class ReadingBatch:
    """Readings of one machine that somebody wants to have stored; once they are, `outcome`."""

    machine_id: str
    readings: Sequence[Reading]
    outcome: StoreOutcome | None = None
    asked_by: Authorization | None = field(default_factory=asking.get)


# The way of readings into the database, and then into memory:
#
#    store_at_once (event loop) ──┐                          plainly right, and all new
#    store_readings (a thread) ───┴─> Together ─> _store_new ─────────────> commit ─> _follow
#                                                     │                                 ^
#                                                     └─ anything else ─> _store_alone ─┘
#
# `_store_new` commits for all who wait at that moment, so it may neither wait for anybody nor
# refuse anything: a batch that is wrong, was partly sent before, or whose machine is being changed
# is left without an outcome. `_store_alone` is then called for it: it waits for locks, compares
# with what is stored, and says what is the matter.
def store_readings(context: Context, machine_id: str, readings: Sequence[Reading]) -> StoreOutcome:
    """Store readings whole or not at all.

    Those that lie in the future are stored, said to be so, and used when their time comes;
    tables go on saying that they came early. Those of more than ten years ago are said to be so.

    Readings that several want to have stored at the same time, of whatever machines, are stored
    in one transaction: a commit costs more than a hundred readings. What is wrong, or not plainly
    new, or would have to wait, goes into a transaction of its own, and holds up nobody. So does
    what a browser's session sends.

    Raises
    ------
    AccessRefused
        If the key of the request may not do it by now.
    InvalidContent
        If a sensor is unknown, a unit mistaken, or a time too far in the future. A value
        out of its sensor's range is stored: it is the sensor's failure, and says so.
    Conflict
        If a time has a reading with other content.
    """
    batch = ReadingBatch(machine_id, readings)
    together = _Together(context)
    context.reading_batches.run(batch, together.store, together.follow)
    return batch.outcome or _store_alone(context, machine_id, readings)


def note_absent(
    context: Context, machine_id: str, absent: Sequence[tuple[datetime, Collection[str]]]
) -> None:
    """Take note of sensors whose senders say that they have no value, until they have one again.

    Parameters
    ----------
    absent
        When, and which sensors. What a later reading has a value of is passed over.
    """
    live = context.live.get(machine_id)
    if live is None:
        return
    now = context.now()
    last = live.last_times({name for _, names in absent for name in names})
    since: dict[str, datetime] = {}
    for time, names in sorted(absent, key=lambda item: item[0]):
        for name in names:
            if name not in last or time > last[name]:
                since.setdefault(name, min(time, now))
    live.note_values((), since)


async def store_at_once(
    context: Context, machine_id: str, readings: Sequence[Reading]
) -> StoreOutcome | None:
    """Store readings of a machine in memory if they are right and all new, as `store_readings`.

    Whoever awaits it takes no thread: those of the queue store them, together with others'. None
    where `store_readings` has to look closer, or nobody could be stored now.
    """
    live = context.live
    if live.get(machine_id) is None or live.database.trouble is not None:
        return None
    if not context.reading_batches.has_room:
        return None  # who has to wait for a place waits with the others
    batch = ReadingBatch(machine_id, readings)
    loop = asyncio.get_running_loop()
    is_done = asyncio.Event()

    def end() -> None:
        with suppress(RuntimeError):  # the loop has ended, and whoever waited with it
            loop.call_soon_threadsafe(is_done.set)

    wanted = Wanted(batch, end)
    together = _Together(context)
    context.reading_batches.begin(wanted, together.store, together.follow)
    await is_done.wait()
    wanted.expect_database()
    return batch.outcome


Written = dict[str, tuple[Sequence[Reading], AddedReadings, int]]
"""By machine: its readings, which of them are new, and how often it had had some withdrawn."""


class _PartlyKnownError(Exception):
    """Some readings of a batch were there already, others are new."""


class _MachineChangedError(Exception):
    """A machine is another than in memory, which has not followed yet."""


class _Together:
    """Stores what is plainly new of several batches, and lets memory follow."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._written: Written = {}

    def store(self, batches: Sequence[ReadingBatch]) -> None:
        """Store batches in one transaction; those that are left have no outcome."""
        self._written = {}
        try:
            with as_service():  # each batch states who wants it
                outcomes, self._written = _store_new(self._context, batches)
        except StorageOvertaken:
            raise  # it was tried often enough
        except (_PartlyKnownError, _MachineChangedError, StorageBusy, AccessRefused):
            return  # whoever met somebody else does so alone, and is told what is the matter
        for batch, outcome in outcomes.items():
            batch.outcome = outcome

    def follow(self, _batches: Sequence[ReadingBatch]) -> None:
        """Let memory follow what was stored."""
        for machine_id, (readings, added, withdrawals) in self._written.items():
            _follow(self._context, machine_id, readings, added, withdrawals)


@repeated
def _store_new(
    context: Context, batches: Sequence[ReadingBatch]
) -> tuple[dict[ReadingBatch, StoreOutcome], Written]:
    """Store those batches that are right and all new, and leave the others.

    They are checked against the machines as they are in memory: what the transaction then holds
    must be of the same shape.

    Raises
    ------
    _PartlyKnownError
        If only a part of one is new: then nothing is stored.
    _MachineChangedError
        If a machine is not what it is in memory: then neither.
    AccessRefused
        If one of those who want it may not: then neither.
    """
    live_machines = {b.machine_id: context.live.get(b.machine_id) for b in batches}
    machines = {m: live for m, live in live_machines.items() if live is not None}
    current = {m: live.current for m, live in machines.items()}
    plain = _plainly_right(context.now(), current, batches)
    if not plain:
        return {}, {}
    asked_by = [b.asked_by for parts in plain.values() for b in parts if b.asked_by is not None]
    wanted = {m: _in_order(chain.from_iterable(parts.values())) for m, parts in plain.items()}
    # Memory has no reading of these times or later: then the database is not asked whether it has,
    # and a violated constraint shows where another process was quicker.
    are_new = all(machines[m].has_none_from(once[0].time) for m, once in wanted.items())
    try:
        with readings_inserted(context.database, wanted, asked_by, are_new=are_new) as rows:
            # They were checked against the machine in memory. Its row is locked by now: with the
            # same revision the sensors are still those that they were checked against.
            if any(current[m].stamp != (row.created_at, row.revision) for m, row in rows.items()):
                raise _MachineChangedError
            stored = [
                (batch, once)
                for machine_id, parts in plain.items()
                for batch, once in parts.items()
                if _is_new(once, rows.get(machine_id))
            ]
    except IntegrityError:
        raise _PartlyKnownError from None  # stored elsewhere, and not heard of here yet
    until = context.usable_until()
    outcomes = {b: _outcome(len(once), len(b.readings), once, until) for b, once in stored}
    return outcomes, {m: (wanted[m], h.added, h.withdrawals) for m, h in rows.items()}


def _plainly_right(
    now: datetime, current: Mapping[str, LiveModel], batches: Sequence[ReadingBatch]
) -> dict[str, dict[ReadingBatch, Sequence[Reading]]]:
    """Choose by machine the batches that are right, each as it is stored, in order of time.

    Of those with a time in common the first is taken.
    """
    plain: dict[str, dict[ReadingBatch, Sequence[Reading]]] = defaultdict(dict)
    for batch in batches:
        live_model = current.get(batch.machine_id)
        by_session = batch.asked_by is not None and batch.asked_by.expires_at is not None
        if live_model is None or by_session:
            continue
        once = _as_stored(now, live_model.model.machine, batch.readings)
        if once and all(_are_apart(once, other) for other in plain[batch.machine_id].values()):
            plain[batch.machine_id][batch] = once
    return {machine_id: parts for machine_id, parts in plain.items() if parts}


def _as_stored(
    now: datetime, machine: Machine, readings: Sequence[Reading]
) -> Sequence[Reading] | None:
    """Give readings as they are stored, in order of time; None where something is wrong."""
    try:
        _check(now, machine, readings)
        return _as_they_arrived(_each_time_once(readings), now)
    except (InvalidContent, Conflict):
        return None


def _are_apart(once: Sequence[Reading], others: Sequence[Reading]) -> bool:
    """Whether two batches, each in order of time, have no time in common."""
    if once[-1].time < others[0].time or others[-1].time < once[0].time:
        return True
    return {r.time for r in once}.isdisjoint(r.time for r in others)


def _is_new(once: Sequence[Reading], row: HeldMachine | None) -> bool:
    """Whether a batch was stored: all of it, or nothing, because it was there or its machine not.

    Raises
    ------
    _PartlyKnownError
        If a part of it was.
    """
    if row is None or row.added.are_all:
        return row is not None
    new = [r.time in row.added.times for r in once]
    if any(new) and not all(new):
        raise _PartlyKnownError
    return all(new)


@repeated
def _store_alone(context: Context, machine_id: str, readings: Sequence[Reading]) -> StoreOutcome:
    now = context.now()
    with context.database.writing() as session:
        row = find_machine(session, machine_id, RowLock.KEPT)
        _check(now, stored_machine(row).machine, readings)
        once = _as_they_arrived(_each_time_once(readings), now)
        added = insert_readings(session, {machine_id: once})[machine_id]
        repeated = [r for r in once if r.time not in added.times]
        stored = find_readings(session, machine_id, [r.time for r in repeated])
        for reading in repeated:
            # One that is not known any more was withdrawn in between.
            if stored.get(reading.time, reading) != reading:
                raise _other_content(stored[reading.time], reading)
    _follow(context, machine_id, once, added, row.withdrawals)
    return _outcome(len(added.numbers), len(readings), once, context.usable_until())


@as_service()
def _follow(
    context: Context,
    machine_id: str,
    readings: Sequence[Reading],
    added: AddedReadings,
    withdrawals: int,
) -> None:
    """Let memory follow what was stored; what goes wrong now is put right later."""
    with suppress(StorageUnavailable, UnknownThing):
        live = context.live.get(machine_id) or load_machine(context, machine_id)
        new = readings if added.are_all else [r for r in readings if r.time in added.times]
        live.add(Arrived(new, withdrawals), context.usable_until())
        context.live.stored_here.note(added.numbers)
        restore_past(context, live)


def _outcome(stored: int, sent: int, once: Sequence[Reading], until: datetime) -> StoreOutcome:
    old = once[: bisect_left(once, until - LONG_AGO, key=_time)]
    ahead = once[bisect_right(once, until, key=_time) :]
    warnings = (*old_warnings(old), *ahead_warnings(ahead))
    return StoreOutcome(stored, sent - stored, len(ahead), warnings)


def _as_they_arrived(once: Sequence[Reading], now: datetime) -> Sequence[Reading]:
    """Note on readings, which are in order of time, that they came before it."""
    first = bisect_right(once, now + CLOCKS_DIFFER, key=_time)
    early = [replace(r, early_s=(r.time - now).total_seconds()) for r in once[first:]]
    return [*once[:first], *early] if early else once


def _check(now: datetime, machine: Machine, readings: Sequence[Reading]) -> None:
    latest = now + MOST_AHEAD_OF_CLOCK
    if max(map(_time, readings), default=latest) <= latest and are_in_range(
        machine, [reading.temperatures_c for reading in readings]
    ):
        return
    for i, reading in enumerate(readings):
        if reading.time > latest:
            message = (
                "expected a time not in the future, or at most a day ahead of the service's clock "
                f"(it is {exact_time(now)}), got {exact_time(reading.time)}: one of the clocks is "
                "wrong, or the time's zone"
            )
            raise InvalidContent(message, [FieldError(f"{i}.time", message)])
        try:
            check_temperatures(machine, reading.temperatures_c)
        except InvalidContent as error:
            raise error.inside(str(i)) from None


def _each_time_once(readings: Sequence[Reading]) -> Sequence[Reading]:
    """Set readings in order of time, each time once; they mostly come like that."""
    times = [*map(_time, readings)]
    if all(map(lt, times, times[1:])):
        return readings
    by_time: dict[datetime, Reading] = {}
    for reading in readings:
        first = by_time.setdefault(reading.time, reading)
        if first != reading:
            raise _other_content(first, reading)
    return _in_order(by_time.values())


def _in_order(readings: Iterable[Reading]) -> list[Reading]:
    """Sort by time, so that two writers of overlapping batches queue in one direction."""
    return sorted(readings, key=_time)


def _other_content(stored: Reading, got: Reading) -> Conflict:
    return Conflict(
        f"the reading of {got.time:%Y-%m-%dT%H:%M:%S.%fZ} is known with other content: "
        f"{dict(stored.temperatures_c)} °C, state {dict(stored.state)}; got "
        f"{dict(got.temperatures_c)} °C, state {dict(got.state)}"
    )


def reading_of_time(context: Context, machine_id: str, time: datetime) -> Reading | None:
    """Find the reading that is stored for an exact time."""
    with context.database.reading() as session:
        return find_readings(session, machine_id, [time]).get(time)


def withdraw_reading(context: Context, machine_id: str, time: datetime) -> int:
    """Withdraw the reading of one time; there is 1."""
    count = withdraw_readings(context, machine_id, time, time)
    if not count:
        raise UnknownThing(
            f"machine {machine_id!r} has no reading of {exact_time(time)}: its time is expected "
            "with all its digits, or a range from … to …"
        )
    return count


@repeated
def withdraw_readings(context: Context, machine_id: str, since: datetime, until: datetime) -> int:
    """Withdraw the readings between two times, both included; say how many there were.

    They count nowhere from then on, and the same may be stored again.

    Raises
    ------
    InvalidContent
        If the second time is before the first.
    """
    if until < since:
        raise InvalidContent.of_field(
            "to", f"expected a time not before {exact_time(since)}, got {exact_time(until)}"
        )
    with context.database.writing() as session:
        machine = find_machine(session, machine_id, RowLock.CHANGED)
        count = withdraw_stored(session, machine, since, until, context.now())
        if count:
            words = f"{counted(count, 'reading')} withdrawn"
            details = {"from": exact_time(since), "to": exact_time(until)}
            write_event(session, machine_id, EventKind.READINGS, words, context.now(), details)
    live = context.live.get(machine_id)
    if count and live is not None:
        live.withdraw(since, until)
        with suppress(StorageUnavailable, UnknownThing):  # the follower tries again
            restore_past(context, live)
    return count
