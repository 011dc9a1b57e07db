"""Bin readings hour by hour, so that a year of them is shown at once.

Whatever is stored has a number; hours into which new numbers fell are binned anew, whole, so that
readings that come late or twice do no harm. On PostgreSQL a smaller number may be committed after
a larger one: one is dealt with when no transaction can still be open that has a smaller one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping
from contextlib import suppress
from datetime import datetime
from time import monotonic
from typing import Final

from app.errors import UnknownThing
from app.services.background import Background
from app.services.context import Context
from app.storage.limits import LONG
from app.storage.machines import RowLock, find_machine
from app.storage.readings import newest_id
from app.storage.temperature_hours import (
    bin_hour,
    binned_up_to,
    hours_written_between,
    note_binned,
    stale_hours,
)

LOOK_EVERY_S: Final = 120.0

SETTLED_S: Final = 150.0
"""No transaction is open for so long (`app.storage.postgresql.IDLE_S`) [s]."""

SLICE: Final = 20_000
"""Readings whose hours are binned before that is noted."""

PAUSE_S: Final = 0.01
"""Between two hours [s]: others write too."""

BINNING_DUTY: Final = 7_483_627
"""PostgreSQL advisory lock: of several services one does this."""


class ReadingBinner(Background):
    """Bins what was stored since it last looked."""

    def __init__(self, context: Context) -> None:
        super().__init__("reading-binner", context.database.duty(BINNING_DUTY))
        self._context = context
        self._seen: deque[tuple[float, int]] = deque()

    def look(self) -> None:
        """Bin all that is settled."""
        while not self._stop.is_set() and self._bin_slice():
            pass

    def _run(self) -> None:
        self._repeat(self.look, LOOK_EVERY_S, "could not bin readings", at_once=True)

    def _bin_slice(self) -> bool:
        """Bin a slice; say whether there may be more."""
        with self._context.database.reading(LONG) as session:
            done = binned_up_to(session)
            until = min(self._settled(newest_id(session)), done + SLICE)
            written = hours_written_between(session, done, until) if until > done else {}
            stale = stale_hours(session, SLICE)
        # Of an hour of which readings have gone, what was binned of it; those above `done` have
        # their turn below, with their hour.
        self._bin(stale, done)
        if not self._bin(written, until):
            return False
        if until > done:
            with self._context.database.writing() as session:
                note_binned(session, until)
        return until == done + SLICE

    def _bin(self, hours: Mapping[str, Collection[datetime]], up_to: int) -> bool:
        """Bin hours of what has a number up to this one; say whether that came to its end."""
        for machine_id, hours_of_machine in hours.items():
            for hour in sorted(hours_of_machine):
                if self._stop.is_set():
                    return False
                with suppress(UnknownThing), self._context.database.writing() as session:
                    find_machine(session, machine_id, RowLock.CHANGED)
                    bin_hour(session, machine_id, hour, up_to)
                self._stop.wait(PAUSE_S)
        return True

    def _settled(self, newest: int) -> int:
        """Say up to which number all readings are committed that ever will be."""
        if self._context.database.is_sqlite:  # which has one writer at a time
            return newest
        # Numbers are given in order, and committed in any. What has a smaller number than the
        # newest one of then was begun before it was seen, and has ended since: no transaction is
        # open for `SETTLED_S`. The last number that was settled stays first in the row, as of long
        # ago, until the next one is.
        now_s = monotonic()
        self._seen.append((now_s, newest))
        settled = 0
        while self._seen and now_s - self._seen[0][0] >= SETTLED_S:
            settled = self._seen.popleft()[1]
        if settled:
            self._seen.appendleft((-SETTLED_S, settled))
        return settled
