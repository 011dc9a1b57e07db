"""The latest readings of one machine, enough of them to judge its sensors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from threading import Lock

from app.thermal.machine import Machine
from app.thermal.reading import Reading
from app.thermal.sensor_health import SensorState, assess_sensors
from app.thermal.temperature_history import TemperatureHistory

LIMIT = 720
"""Readings kept a machine; between readings that come faster than the window divided
by this, only the newest is kept."""


class ReadingWindow:
    """Readings in order of time back to the longest time in which a sensor can be stuck."""

    def __init__(self) -> None:
        self._readings: tuple[Reading, ...] = ()
        self._lock = Lock()
        self._judged: tuple[tuple[Reading, ...], Machine, list[SensorState]] | None = None

    @property
    def latest(self) -> Reading | None:
        """The newest reading."""
        readings = self._readings
        return readings[-1] if readings else None

    def add(self, machine: Machine, readings: Iterable[Reading]) -> None:
        """Take readings in, in any order; those already there are passed over."""
        with self._lock:
            by_time = {reading.time: reading for reading in (*readings, *self._readings)}
            ordered = [by_time[time] for time in sorted(by_time)]
            self._readings = _thinned(ordered, window_s(machine))

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


def window_s(machine: Machine) -> float:
    """How far back readings are kept: twice the longest `stuck_after_s` [s]."""
    return 2.0 * max((s.stuck_after_s for s in machine.sensors.values()), default=0.0)


def _thinned(ordered: Sequence[Reading], span_s: float) -> tuple[Reading, ...]:
    """Keep the newest and, back to the window's beginning, one for each spacing."""
    kept: list[Reading] = []
    for reading in ordered:
        if not kept or _seconds_between(kept[-1], reading) >= span_s / LIMIT:
            kept.append(reading)
    if ordered and kept[-1] is not ordered[-1]:
        kept.append(ordered[-1])
    return tuple(r for r in kept if _seconds_between(r, kept[-1]) <= span_s)


def _seconds_between(earlier: Reading, later: Reading) -> float:
    return (later.time - earlier.time).total_seconds()
