"""Thin readings that are old: of each sensor one value in each interval is left."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from typing import Final

from app.services.context import Context
from app.storage.error_maps import measured_times
from app.storage.machines import RowLock, find_machine, stored_machine
from app.storage.readings import delete_readings_at, readings_after
from app.storage.verifications import observed_spans
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
