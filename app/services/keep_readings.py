"""Make room for readings, and let go of those that nobody needs any more."""

from __future__ import annotations

import logging
from contextlib import suppress
from datetime import datetime, timedelta
from typing import Final

from app.errors import UnknownThing
from app.services.background import Background
from app.services.context import Context
from app.services.thin_readings import LOOKED_BACK_ON, ReadingThinner
from app.storage.limits import LONG
from app.storage.machines import RowLock, find_machine, machine_ids
from app.storage.partitions import drop_months, make_months, months_made
from app.storage.readings import delete_some_readings
from app.storage.temperature_hours import delete_hours
from app.storage.verifications import first_observation

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
