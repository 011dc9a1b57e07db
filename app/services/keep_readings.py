"""Make room for readings: thin those that are old, and let go of those that nobody needs."""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Final

from app.errors import UnknownThing
from app.services.background import Background
from app.services.context import Context
from app.storage.error_maps import measured_times
from app.storage.limits import LONG
from app.storage.machines import RowLock, find_machine, machine_ids, stored_machine
from app.storage.partitions import drop_months, make_months, months_made
from app.storage.readings import delete_readings_at, delete_some_readings, readings_after
from app.storage.temperature_hours import delete_hours
from app.storage.verifications import first_observation, observed_spans
from app.thermal.reading import Reading

LOOKED_BACK_ON: Final = timedelta(days=31)
"""What is left as it is before a map and a verification: analyses read it again. Adopted lags, and
what an analysis looks back over, are far shorter."""

AFTER_A_MAP: Final = timedelta(days=1)
"""A map states one time of those that its measurement took."""

Span = tuple[datetime, datetime]


@dataclass(slots=True)
class Thinning:
    """How far a machine's readings have been thinned: up to a time, and what that interval has."""

    after: datetime
    place: float = 0.0
    sensors: set[str] = field(default_factory=set)

    def pass_over(
        self, readings: Iterable[Reading], every_s: float, spared: Collection[Span]
    ) -> list[datetime]:
        """Go on over readings in order of time; give the times of those that are not needed.

        Parameters
        ----------
        every_s
            Length of the intervals, counted from 1970 [s]; the first value in each is kept.
        spared
            Spans of time, both ends included, in which all are kept.
        """
        passed_over = []
        for reading in readings:
            self.after = reading.time
            place = reading.time.timestamp() // every_s
            if place != self.place:
                self.place, self.sensors = place, set()
            is_spared = any(first <= reading.time <= last for first, last in spared)
            if not is_spared and self.sensors.issuperset(reading.temperatures_c):
                passed_over.append(reading.time)
            self.sensors.update(reading.temperatures_c)
        return passed_over


class ReadingThinner:
    """Thins what is older than so many days, of each machine from where it stopped.

    It goes over all old readings once after a start. Nothing is taken from the 31 days before a
    map or a verification, nor from what the machine's adopted lags read again.

    Parameters
    ----------
    after_days
        Age from which readings are thinned [days].
    every_s
        Length of the intervals of which each sensor keeps one value [s], or half of what the most
        impatient sensor of a machine calls stale, if that is shorter.
    """

    def __init__(self, context: Context, after_days: int, every_s: float) -> None:
        self._context = context
        self._after = timedelta(days=after_days)
        self._every_s = every_s
        self._reached: dict[str, Thinning] = {}

    def thin_some(self, machine_id: str, most: int) -> tuple[int, bool]:
        """Go over so many readings at most; say how many were deleted, and whether more wait."""
        before = self._context.now() - max(self._after, self._read_again(machine_id))
        thinning = self._reached.get(machine_id)
        going = Thinning(datetime.min.replace(tzinfo=before.tzinfo))
        if thinning is not None:
            # A copy, which counts after the commit alone: a slice that failed is gone over again.
            going = Thinning(thinning.after, thinning.place, set(thinning.sensors))
        with self._context.database.writing() as session:
            row = find_machine(session, machine_id, RowLock.KEPT)
            old = readings_after(session, machine_id, going.after, most)
            maps, visits = measured_times(session, row.id), observed_spans(session, row.id)
            spared = [(at - LOOKED_BACK_ON, at + AFTER_A_MAP) for at in maps]
            spared += [(first - LOOKED_BACK_ON, last) for first, last in visits]
            sensors = stored_machine(row).machine.sensors.values()
            every_s = min([self._every_s, *(s.max_age_s / 2.0 for s in sensors)])
            due = [reading for reading in old if reading.time < before]
            times = going.pass_over(due, every_s, spared)
            delete_readings_at(session, machine_id, times)
        self._reached[machine_id] = going
        return len(times), len(due) == most

    def _read_again(self, machine_id: str) -> timedelta:
        live = self._context.live.get(machine_id)
        return timedelta(seconds=0.0 if live is None else live.past.record_s)


log = logging.getLogger("thermap")

LOOK_EVERY_S: Final = 3600.0

SLICE: Final = 2000
"""Readings that are deleted in one transaction: nobody waits long for it."""

PAUSE_S: Final = 0.05
"""Between two of them [s]: others write too."""

KEEPER_DUTY: Final = 7_483_623
"""PostgreSQL advisory lock: of several services one does this."""


class ReadingKeeper(Background):
    """Makes months of readings ahead, and deletes or thins what is old.

    Nothing is deleted that a stored verification needs: of each machine all stays from
    `LOOKED_BACK_ON` before its oldest one.

    Parameters
    ----------
    keep_days
        Age from which readings are deleted [days]; None keeps all.
    thin_after_days
        Age from which they are thinned [days]; None keeps all.
    thin_to_s
        To one value of each sensor in so long [s].
    """

    def __init__(
        self,
        context: Context,
        keep_days: int | None,
        thin_after_days: int | None = None,
        thin_to_s: float = 60.0,
    ) -> None:
        super().__init__("reading-keeper", context.database.duty(KEEPER_DUTY))
        self._context = context
        self._keep_days = keep_days
        self._thinner = (
            None if thin_after_days is None else ReadingThinner(context, thin_after_days, thin_to_s)
        )

    def look(self) -> int:
        """Do once what is due; return how many readings were deleted one by one."""
        context = self._context
        if not context.database.is_sqlite:
            with context.database.writing() as session:
                make_months(session.connection(), context.now())
        return self._delete_old() + self._thin_old()

    def _delete_old(self) -> int:
        context = self._context
        if self._keep_days is None:
            return 0
        before = context.now() - timedelta(days=self._keep_days)
        needed_from = self._needed_from(before)
        if not context.database.is_sqlite:
            self._drop_months(min([before, *needed_from.values()]))
        return sum(self._delete(machine_id, until) for machine_id, until in needed_from.items())

    def _thin_old(self) -> int:
        if self._thinner is None:
            return 0
        with self._context.database.reading() as session:
            machines = machine_ids(session)
        return sum(self._thin(self._thinner, machine_id) for machine_id in machines)

    def _thin(self, thinner: ReadingThinner, machine_id: str) -> int:
        """Thin a machine's readings, in slices."""
        total, more = 0, True
        with suppress(UnknownThing):
            while more and not self._stop.is_set():
                count, more = thinner.thin_some(machine_id, SLICE)
                total += count
                if more:
                    self._stop.wait(PAUSE_S)
        return total

    def _needed_from(self, before: datetime) -> dict[str, datetime]:
        """Say for each machine until when readings go: those of verifications stay."""
        needed_from = {}
        with self._context.database.reading(LONG) as session:
            for machine_id in machine_ids(session):
                first = first_observation(session, machine_id)
                needed = before if first is None else min(before, first - LOOKED_BACK_ON)
                needed_from[machine_id] = needed
        return needed_from

    def _drop_months(self, before: datetime) -> None:
        with self._context.database.reading() as session:
            if not months_made(session.connection()):
                return
        with self._context.database.writing(LONG) as session:
            dropped = drop_months(session.connection(), before)
        for month in dropped:
            log.info("readings of %s dropped", f"{month:%Y-%m}")

    def _delete(self, machine_id: str, before: datetime) -> int:
        """Delete a machine's readings before a time, in slices."""
        total = 0
        while not self._stop.is_set():
            try:
                with self._context.database.writing() as session:
                    find_machine(session, machine_id, RowLock.KEPT)
                    count = delete_some_readings(session, machine_id, before, SLICE)
                    delete_hours(session, machine_id, before)
            except UnknownThing:
                break
            total += count
            if count < SLICE:
                break
            self._stop.wait(PAUSE_S)
        return total

    def _run(self) -> None:
        self._repeat(self.look, LOOK_EVERY_S, "could not make room for readings", at_once=True)
