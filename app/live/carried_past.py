"""The past that adopted effects need, carried along as readings arrive.

Readings that come late, or in another order, cannot be put into a filter that has gone on:
then it is behind, and is rebuilt from the stored history. Those that arrive meanwhile wait.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from threading import Lock

from app.effects.adopted.live_lags import LiveLags
from app.effects.past import Needed, Past
from app.thermal.machine import Machine
from app.thermal.reading import Reading
from app.thermal.sensor_health import believed, record_needed_s
from app.thermal.temperature_history import TemperatureHistory

REMEMBERED = 20_000
"""Readings that are known again when they come twice: who follows a database sees its own."""

NO_PAST = Past(LiveLags({}))
"""Of the many machines whose effects need none, or that have none."""


class CarriedPast:
    """One machine's past: `now` is replaced whole, so a reader never sees half of one."""

    def __init__(self, machine: Machine, needed: Needed) -> None:
        self._machine = machine
        self._needed = needed
        self._lock = Lock()
        self._restoring = Lock()
        self._known: dict[float, None] = {}
        self._waiting: list[Reading] | None = None
        self.now = Past.unread(machine.sensors, needed) if needed else NO_PAST
        self.is_behind = bool(needed)

    @property
    def record_s(self) -> float:
        """How far back stored readings must go to restore it [s]."""
        return self._needed.record_s + record_needed_s(self._machine.sensors.values())

    def serves(self, machine: Machine, needed: Needed) -> bool:
        """Whether it is what another model of the machine needs."""
        return needed == self._needed and machine.sensors == self._machine.sensors

    def add(self, before: Sequence[Reading], readings: Iterable[Reading]) -> None:
        """Take readings in, in any order; those already there are passed over.

        Parameters
        ----------
        before
            The latest readings without them, in order of time: to judge sensors by.
        """
        if not self._needed:
            return
        with self._lock:
            new = [r for r in readings if r.time.timestamp() not in self._known]
            if self._waiting is not None:
                # Noted, and taken in below all the same: until it is rebuilt, tables go on with
                # what there is.
                self._waiting.extend(new)
            if new:
                self._take(before, sorted(new, key=lambda reading: reading.time))

    def restore(self, read: Callable[[], Sequence[Reading]]) -> None:
        """Rebuild from stored readings, if it is behind.

        Parameters
        ----------
        read
            Reads the latest stored ones, back over `record_s`, in order of time.
        """
        with self._restoring:
            # Another thread may have rebuilt it while this one waited.
            if not self.is_behind:
                return
            with self._lock:
                # From here on arrivals are noted, and only then is the database read: what was
                # committed before is read, what is committed later is noted, and some of it both.
                self._waiting = []
            try:
                stored = _in_order([*read(), *self._arrived_meanwhile()])
                past = self._of_record(stored)  # outside the lock: arrivals do not wait for it
                with self._lock:
                    self._begin_with(past, stored)
                    stored_times = {reading.time for reading in stored}
                    new = _in_order(r for r in self._waiting if r.time not in stored_times)
                    self._take(stored, new)
                    if self.is_behind:
                        # Among those noted was one that is older than the newest that was read.
                        # This time the others wait, so that it comes to an end.
                        together = _in_order([*stored, *new])
                        self._begin_with(self._of_record(together), together)
            finally:
                self._waiting = None

    def _take(self, before: Sequence[Reading], new: Sequence[Reading]) -> None:
        self._remember(new)
        times = {reading.time for reading in new}
        together = [*(r for r in before if r.time not in times), *new]
        together.sort(key=lambda reading: reading.time)
        history = self._believed(together)
        past = self.now
        for i, reading in enumerate(together):
            if reading.time not in times:
                continue
            time_s = reading.time.timestamp()
            present = {s: v for s, t in history.temperatures_c.items() if (v := float(t[i])) == v}
            if past.is_out_of_order(time_s, present, reading.state):
                self.is_behind = True
            else:
                past = past.update(time_s, present, reading.state)
        self.now = past

    def _arrived_meanwhile(self) -> list[Reading]:
        with self._lock:
            return list(self._waiting or ())

    def _of_record(self, ordered: Sequence[Reading]) -> Past:
        states = [(r.time.timestamp(), r.state) for r in ordered]
        return Past.of_record(self._machine.sensors, self._needed, self._believed(ordered), states)

    def _begin_with(self, past: Past, readings: Sequence[Reading]) -> None:
        self.now = past
        self._known.clear()
        self._remember(readings)
        self.is_behind = False

    def _believed(self, ordered: Sequence[Reading]) -> TemperatureHistory:
        """Take the record of the sensors that are filtered, without what cannot be believed."""
        history = TemperatureHistory.of_readings(
            self._machine.sensors, [(r.time.timestamp(), r.temperatures_c) for r in ordered]
        )
        return believed(self._machine, history, self._needed.sensors)

    def _remember(self, readings: Sequence[Reading]) -> None:
        self._known.update(dict.fromkeys(r.time.timestamp() for r in readings[-REMEMBERED:]))
        for oldest in list(self._known)[:-REMEMBERED]:
            del self._known[oldest]


def _in_order(readings: Iterable[Reading]) -> list[Reading]:
    """Set readings in order of time, each time once."""
    by_time = {reading.time: reading for reading in readings}
    return [by_time[time] for time in sorted(by_time)]
