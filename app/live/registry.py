"""Every machine's compiled model and latest readings, in memory.

The live table is answered from here alone, so it goes on when the database is
away. Models are replaced whole and only by newer ones, so a reader never sees
half of one.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from threading import Lock

from app.effects.effect import Effect
from app.effects.past import Needed, needed_past
from app.live.carried_past import CarriedPast
from app.live.database_watch import DatabaseWatch
from app.live.reading_window import MOST_AHEAD, ReadingWindow
from app.live.unseen_numbers import StoredHere
from app.thermal.compiled_model import CompiledModel
from app.thermal.reading import Reading


@dataclass(frozen=True, eq=False)
class LiveModel:
    """A machine's active model with its adopted effects, as of one revision of the machine."""

    model: CompiledModel
    version: int | None
    created_at: datetime
    revision: int
    loaded_at: datetime
    effects: tuple[Effect, ...] = ()

    @property
    def stamp(self) -> tuple[datetime, int]:
        """Birth and revision of the machine: newer shapes have larger stamps."""
        return (self.created_at, self.revision)

    @cached_property
    def needed(self) -> Needed:
        """What its effects need of the past."""
        return needed_past(self.effects)


@dataclass(frozen=True, slots=True)
class Arrived:
    """Readings that came, and how often their machine had had some withdrawn until then."""

    readings: Sequence[Reading]
    withdrawals: int


class LiveMachine:
    """What is known of one machine now: its model, its latest readings, and their past.

    `until` is everywhere the latest time at which a reading can have been measured.
    `is_behind` says that the readings have to be read from the database: there may be others
    than those that are here. `without_value` are sensors whose senders say that they have no
    value, and since when; it is known where it was said, and ends with the next value.
    """

    def __init__(self, current: LiveModel) -> None:
        self.current = current
        self.readings = ReadingWindow()
        self.past = CarriedPast(current.model.machine, current.needed)
        self.withdrawals = 0
        self.is_behind = True
        self.without_value: Mapping[str, datetime] = {}
        self._lock = Lock()
        self._lock_of_values = Lock()
        self._notes: dict[int, list[Arrived]] = {}

    def replace(self, current: LiveModel) -> None:
        """Put another model in place; what other sensors or effects need has to be read."""
        machine = current.model.machine
        with self._lock:
            if not self.past.serves(machine, current.needed):
                self.past = CarriedPast(machine, current.needed)
            if machine.sensors != self.current.model.machine.sensors:
                self.is_behind = True
            self.current = current

    def expect(self, withdrawals: int) -> None:
        """Take note of how often readings were withdrawn: if not as here, they are behind."""
        with self._lock:
            if withdrawals != self.withdrawals:
                self.is_behind = True

    def add(self, arrived: Arrived, until: datetime) -> None:
        """Take readings in, in any order; those already there are passed over."""
        with self._lock:
            for note in self._notes.values():
                note.append(arrived)
            # Storing and withdrawing at the same time: each withdrawal is counted in its own
            # transaction, and whatever arrives says how many there had been. Where the counts are
            # equal both have seen the same withdrawals, and the readings can be put together.
            if arrived.withdrawals == self.withdrawals:
                self._take(arrived.readings, until)
            else:
                # Some of them may have been withdrawn since, or some of those here.
                self.is_behind = True
        # After the lock was given back: `note_values` takes another, and no thread has both.
        if without := self.without_value:
            latest = {n: r.time for r in arrived.readings for n in r.temperatures_c if n in without}
            self.note_values([name for name, time in latest.items() if time >= without[name]], {})

    def note_values(self, present: Collection[str], absent: Mapping[str, datetime]) -> None:
        """Take note of which sensors have a value, and of whom it is said that they have none."""
        if absent or not self.without_value.keys().isdisjoint(present):
            with self._lock_of_values:
                absent_since = {**absent, **self.without_value}
                sensors = self.current.model.machine.sensors.keys() - set(present)
                self.without_value = {k: t for k, t in absent_since.items() if k in sensors}

    def last_times(self, sensors: Collection[str]) -> Mapping[str, datetime]:
        """Say when each of some sensors had its latest value, where it had any."""
        times: dict[str, datetime] = {}
        for reading in reversed(self.readings.held.used):
            times |= {n: reading.time for n in sensors if n in reading.temperatures_c} | times
            if len(times) == len(sensors):
                break
        return times

    def has_none_from(self, time: datetime) -> bool:
        """Whether the database has no reading of this time or later, as far as is known here."""
        window = self.readings.held
        last = window.ahead[-1:] or window.used[-1:]
        return not self.is_behind and not window.more_ahead and all(r.time < time for r in last)

    def advance_to(self, until: datetime) -> None:
        """Use what lay ahead and has come; if the clock was set back, leave what now lies ahead.

        A comparison, except when there is something to do; it asks no database.
        """
        # Asked without the lock, as `held` is replaced whole: a second thread finds nothing left to
        # do.
        if not self.readings.held.is_as_of(until):
            with self._lock:
                self._take((), until)

    def withdraw(self, since: datetime, until: datetime) -> None:
        """Let go of the readings between two times at once, until they are read again."""
        with self._lock:
            self.readings.drop(since, until)
            self._begin_past_anew()
            self.is_behind = True

    @contextmanager
    def noting_arrivals(self) -> Iterator[list[Arrived]]:
        """Note what arrives while the database is being read."""
        noted: list[Arrived] = []
        with self._lock:
            # By identity: two may read at the same time, and their empty lists are equal.
            self._notes[id(noted)] = noted
        try:
            yield noted
        finally:
            with self._lock:
                del self._notes[id(noted)]

    def reread(self, stored: Arrived, meanwhile: Iterable[Arrived], until: datetime) -> None:
        """Hold what the database has, and what arrived while that was read, and no others."""
        with self._lock:
            if stored.withdrawals < self.withdrawals:
                return  # somebody else read later
            if stored.withdrawals > self.withdrawals:
                self._begin_past_anew()
            arrived = list(meanwhile)
            comparable = [a for a in arrived if a.withdrawals == stored.withdrawals]
            readings = [*stored.readings, *(r for a in comparable for r in a.readings)]
            self.readings.replace(self.current.model.machine, readings, until)
            self.withdrawals = stored.withdrawals
            self.is_behind = len(comparable) < len(arrived)
            self.past.add(self.readings.held.used, [r for r in readings if r.time <= until])

    def _take(self, readings: Sequence[Reading], until: datetime) -> None:
        machine, window = self.current.model.machine, self.readings.held
        usable = self.readings.add(machine, readings, until)
        before = window.used
        if window.reaches_past(until):
            # The window was that of a time that has not come, and let go of what it needs now.
            self._begin_past_anew()
            self.is_behind = True
            before = self.readings.held.used
        if window.more_ahead and len(self.readings.held.ahead) < MOST_AHEAD // 2:
            self.is_behind = True
        self.past.add(before, usable)

    def _begin_past_anew(self) -> None:
        self.past = CarriedPast(self.current.model.machine, self.current.needed)


class LiveRegistry:
    """The machines in memory, by id."""

    def __init__(self) -> None:
        self._machines: dict[str, LiveMachine] = {}
        self._lock = Lock()
        self.database = DatabaseWatch()
        self.stored_here = StoredHere()

    def get(self, machine_id: str) -> LiveMachine | None:
        """Find a machine that is in memory."""
        return self._machines.get(machine_id)

    def ids(self) -> set[str]:
        """Name the machines that are in memory."""
        return set(self._machines)

    def stamps(self) -> dict[str, tuple[datetime, int, int]]:
        """Say in which shape each machine is in memory: birth, revision and withdrawals."""
        return {
            machine_id: (*m.current.stamp, m.withdrawals)
            # A copy in one step: machines come and go in other threads.
            for machine_id, m in list(self._machines.items())
        }

    def stamp(self, machine_id: str) -> tuple[datetime, int, int] | None:
        """Say the same of one machine; None where it is not in memory."""
        live = self._machines.get(machine_id)
        return None if live is None else (*live.current.stamp, live.withdrawals)

    def publish(self, live: LiveModel) -> LiveMachine:
        """Put a machine's model in place, unless a newer one is there already.

        It keeps the readings that it has; one that is new here is behind with them.
        """
        machine = live.model.machine
        with self._lock:
            present = self._machines.get(machine.id)
            if present is None or present.current.created_at != live.created_at:
                # Commits of one machine come one after the other, but who committed first may come
                # here last: the older model is dropped. Another birth is another machine of the
                # same id.
                if present is not None and present.current.stamp > live.stamp:
                    return present
                present = LiveMachine(live)
                self._machines[machine.id] = present
            elif live.stamp >= present.current.stamp:
                present.replace(live)
            return present

    def forget(self, machine_id: str) -> None:
        """Take a deleted machine out of memory."""
        with self._lock:
            self._machines.pop(machine_id, None)

    def machines(self) -> list[LiveMachine]:
        """List the machines by id."""
        return [machine for _, machine in sorted(self._machines.copy().items())]

    def behind(self) -> list[LiveMachine]:
        """List the machines whose readings or past have to be read from the database."""
        return [m for m in list(self._machines.values()) if m.is_behind or m.past.is_behind]

    def __len__(self) -> int:
        return len(self._machines)
