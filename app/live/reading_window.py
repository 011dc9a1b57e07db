"""The latest readings of one machine, enough of them to judge its sensors."""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict, deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from statistics import median
from threading import Lock

import numpy as np

from app.arrays import IntArray
from app.thermal.machine import Machine, Sensor
from app.thermal.reading import Reading
from app.thermal.sensor_health import (
    MISSED,
    RECENT,
    JudgedRecord,
    SensorState,
    judged_record,
    record_needed_s,
)
from app.thermal.temperature_history import TemperatureHistory

LIMIT = 720
"""Values kept a sensor; of those that come faster than the window divided by this, one
for each such spacing."""


MOST_AHEAD = 1000
"""Readings of the future that are kept: those whose time comes first. The database has all."""


@dataclass(frozen=True, slots=True)
class HeldReadings:
    """What a window holds at one moment, in order of time.

    `used` can have been measured; `ahead` lies in the future, and is not used until its
    time comes. `more_ahead` says that later ones are left to the database. `early` are those
    in use that arrived before their time, as long as they have the newest value of a sensor.
    """

    used: tuple[Reading, ...] = ()
    ahead: tuple[Reading, ...] = ()
    more_ahead: bool = False
    early: tuple[Reading, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "early", _early_in_use(self.used))

    @property
    def latest(self) -> Reading | None:
        """The newest reading that can be used."""
        return self.used[-1] if self.used else None

    def is_as_of(self, until: datetime) -> bool:
        """Whether none ahead has come by a time, and none in use lies after it."""
        return not (
            (self.used and self.used[-1].time > until)
            or (self.ahead and self.ahead[0].time <= until)
        )

    def reaches_past(self, until: datetime) -> bool:
        """Whether a reading in use lies after a time: the clock has been set back."""
        return bool(self.used and self.used[-1].time > until)


class _Arrivals:
    """How readings arrive: one by one or many together, at once or some time after they were taken.

    What is sent every minute is not late for a minute, though it was read every second.
    """

    def __init__(self) -> None:
        self._newest: dict[str, datetime] = {}
        self._steps_s: defaultdict[str, deque[float]] = defaultdict(lambda: deque(maxlen=RECENT))
        self._delays_s: deque[float] = deque(maxlen=RECENT)

    def note(self, readings: Sequence[Reading], until: datetime) -> None:
        """Note what came together at a time."""
        came: dict[str, datetime] = {}
        for reading in readings:
            if reading.time <= until:
                for sensor in reading.temperatures_c:
                    came[sensor] = max(reading.time, came.get(sensor, reading.time))
        for sensor, time in came.items():
            before = self._newest.get(sensor)
            if before is not None and time > before:
                self._steps_s[sensor].append((time - before).total_seconds())
            self._newest[sensor] = max(time, before or time)
        if came:
            self._delays_s.append((until - max(came.values())).total_seconds())

    def patient(self, state: SensorState) -> SensorState:
        """Let a sensor be late no sooner than its sender is."""
        if state.late_after_s is None:
            return state
        step_s = median(self._steps_s[state.sensor] or (0.0,))
        late_after_s = max(state.late_after_s, MISSED * step_s) + min(self._delays_s, default=0.0)
        return state._replace(late_after_s=late_after_s)


class ReadingWindow:
    """Readings in order of time, as far back as a judgement of the sensors needs them.

    `until` is everywhere the latest time that a reading can have been measured at. `held` is
    replaced whole, so a reader never sees half of a change.
    """

    def __init__(self) -> None:
        self.held = HeldReadings()
        self._lock = Lock()
        self._arrivals = _Arrivals()
        self._judged: tuple[tuple[Reading, ...], Machine, JudgedRecord] | None = None

    @property
    def latest(self) -> Reading | None:
        """The newest reading that can be used."""
        return self.held.latest

    def add(self, machine: Machine, readings: Iterable[Reading], until: datetime) -> list[Reading]:
        """Take readings in, in any order; those already there are passed over.

        Returns
        -------
        list of Reading
            Those that can be used from now on: of the ones that came, and of the ones that
            were ahead.
        """
        with self._lock:
            window = self.held
            came = list(readings)
            times = {reading.time for part in (window.used, window.ahead) for reading in part}
            new = [reading for reading in came if reading.time not in times]
            if not new and window.is_as_of(until):
                return [reading for reading in came if reading.time <= until]
            self.held = _split([*new, *window.used, *window.ahead], machine, until, window)
            self._arrivals.note(came, until)
            # One that was ahead can come again: it is taken once.
            usable = {r.time: r for r in (*came, *window.ahead) if r.time <= until}
            return [*usable.values()]

    def replace(self, machine: Machine, readings: Iterable[Reading], until: datetime) -> None:
        """Hold these readings and no others."""
        with self._lock:
            self.held = _split(readings, machine, until, HeldReadings())

    def drop(self, since: datetime, until: datetime) -> None:
        """Let go of the readings between two times, both included."""
        with self._lock:
            window = self.held
            used, ahead = (
                tuple(r for r in part if not since <= r.time <= until)
                for part in (window.used, window.ahead)
            )
            self.held = HeldReadings(used, ahead, window.more_ahead)

    def judge(self, machine: Machine) -> Sequence[SensorState]:
        """Judge every sensor at the time of the latest reading."""
        return self.record(machine).states

    def record(self, machine: Machine) -> JudgedRecord:
        """Judge every value of every sensor."""
        readings = self.held.used
        judged = self._judged
        # By identity, since neither is ever changed in place. Without a lock: of two threads that
        # judge at once each has a whole record.
        if judged is None or judged[0] is not readings or judged[1] is not machine:
            history = TemperatureHistory.of_readings(
                machine.sensors, [(r.time.timestamp(), r.temperatures_c) for r in readings]
            )
            record = judged_record(machine, history)
            states = [self._arrivals.patient(state) for state in record.states]
            judged = (readings, machine, replace(record, states=states))
            self._judged = judged
        return judged[2]


def _split(
    readings: Iterable[Reading], machine: Machine, until: datetime, before: HeldReadings
) -> HeldReadings:
    """Set readings in order, and what can be used apart from what lies ahead."""
    by_time = {reading.time: reading for reading in readings}
    ordered = [by_time[time] for time in sorted(by_time)]
    count = bisect_right(ordered, until, key=lambda reading: reading.time)
    ahead = ordered[count:]
    if before.more_ahead and before.ahead:
        # Beyond its last one there are others in the database: no later one may come first.
        ahead = [reading for reading in ahead if reading.time <= before.ahead[-1].time]
    more = before.more_ahead or len(ahead) > MOST_AHEAD
    return HeldReadings(_thinned(ordered[:count], machine), tuple(ahead[:MOST_AHEAD]), more)


def _early_in_use(used: Sequence[Reading]) -> tuple[Reading, ...]:
    """Find those that arrived before their time and have the newest value of a sensor."""
    if not any(reading.early_s for reading in used):
        return ()
    newest = {sensor: reading for reading in used for sensor in reading.temperatures_c}
    in_use = {reading.time: reading for reading in newest.values() if reading.early_s}
    return tuple(in_use[time] for time in sorted(in_use))


def kept_spacing_s(sensors: Iterable[Sensor]) -> float:
    """How far apart the kept values of a sensor are where they come faster [s]."""
    return record_needed_s(sensors) / LIMIT


def _thinned(ordered: Sequence[Reading], machine: Machine) -> tuple[Reading, ...]:
    """Keep for each sensor its newest values, and one for each spacing of the window.

    Sensors may report apart from each other, so each has its own reckoning; a sensor's
    newest value stays however old it is. Spacings are counted from 1970, and the first value in
    each that overlaps the window is kept: the same readings leave the same ones in whatever order
    they came.
    """
    if not ordered:
        return ()
    span_s = record_needed_s(machine.sensors.values())
    spacing_s = kept_spacing_s(machine.sensors.values())
    times_s = np.array([reading.time.timestamp() for reading in ordered])
    places = times_s // spacing_s if spacing_s else times_s
    overlaps = times_s[-1] - (places + 1.0) * spacing_s < span_s
    needed: set[int] = set()
    for having in _indices_of_sensors(ordered):
        begins = np.append(True, np.diff(places[having]) != 0)
        needed.update(having[begins & overlaps[having]].tolist())
        newest = having[-RECENT:]
        needed.update(newest[overlaps[newest]].tolist())
        needed.update(having[-2:].tolist())
    return tuple(ordered[i] for i in sorted(needed))


def _indices_of_sensors(ordered: Sequence[Reading]) -> list[IntArray]:
    """Say for each sensor which readings have it; once for all of them where each has all."""
    together = ordered[0].temperatures_c.keys()
    if all(reading.temperatures_c.keys() == together for reading in ordered):
        return [np.arange(len(ordered))]
    by_sensor: dict[str, list[int]] = defaultdict(list)
    for i, reading in enumerate(ordered):
        for sensor in reading.temperatures_c:
            by_sensor[sensor].append(i)
    return [np.array(indices) for indices in by_sensor.values()]
