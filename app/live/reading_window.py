"""The latest readings of one machine, enough of them to judge its sensors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import inf
from threading import Lock

from app.thermal.machine import Machine, Sensor
from app.thermal.reading import Reading
from app.thermal.sensor_health import SensorState, assess_sensors, record_needed_s
from app.thermal.temperature_history import TemperatureHistory

LIMIT = 720
"""Values kept a sensor; of those that come faster than the window divided by this, one
for each such spacing."""


class ReadingWindow:
    """Readings in order of time, as far back as a judgement of the sensors needs them."""

    def __init__(self) -> None:
        self._readings: tuple[Reading, ...] = ()
        self._lock = Lock()
        self._judged: tuple[tuple[Reading, ...], Machine, list[SensorState]] | None = None

    @property
    def latest(self) -> Reading | None:
        """The newest reading."""
        readings = self._readings
        return readings[-1] if readings else None

    @property
    def kept(self) -> Sequence[Reading]:
        """The readings that are kept, in order of time."""
        return self._readings

    def add(self, machine: Machine, readings: Iterable[Reading]) -> None:
        """Take readings in, in any order; those already there are passed over."""
        with self._lock:
            known = {reading.time for reading in self._readings}
            new = [reading for reading in readings if reading.time not in known]
            if not new:
                return
            by_time = {reading.time: reading for reading in (*new, *self._readings)}
            ordered = [by_time[time] for time in sorted(by_time)]
            self._readings = _thinned(ordered, machine)

    def judge(self, machine: Machine) -> list[SensorState]:
        """Judge every sensor at the time of the latest reading."""
        readings = self._readings
        judged = self._judged
        if judged is None or judged[0] is not readings or judged[1] is not machine:
            history = TemperatureHistory.of_readings(
                machine.sensors, [(r.time.timestamp(), r.temperatures_c) for r in readings]
            )
            judged = (readings, machine, assess_sensors(machine, history))
            self._judged = judged
        return judged[2]


def kept_spacing_s(sensors: Iterable[Sensor]) -> float:
    """How far apart the kept values of a sensor are where they come faster [s]."""
    return record_needed_s(sensors) / LIMIT


def _thinned(ordered: Sequence[Reading], machine: Machine) -> tuple[Reading, ...]:
    """Keep for each sensor its two newest values, and one for each spacing of the window.

    Sensors may report apart from each other, so each has its own reckoning; a sensor's
    newest value stays however old it is.
    """
    span_s = record_needed_s(machine.sensors.values())
    spacing_s = kept_spacing_s(machine.sensors.values())
    newest_s = ordered[-1].time.timestamp() if ordered else 0.0
    needed: set[int] = set()
    kept_s: dict[str, float] = {}
    last_two: dict[str, tuple[int, int]] = {}
    for i, reading in enumerate(ordered):
        time_s = reading.time.timestamp()
        for sensor in reading.temperatures_c:
            last_two[sensor] = (last_two.get(sensor, (i, i))[1], i)
            if newest_s - time_s <= span_s and time_s - kept_s.get(sensor, -inf) >= spacing_s:
                kept_s[sensor] = time_s
                needed.add(i)
    for pair in last_two.values():
        needed.update(pair)
    return tuple(ordered[i] for i in sorted(needed))
