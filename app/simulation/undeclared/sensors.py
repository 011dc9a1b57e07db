"""What the temperature sensors say: noise, rounding, stand-stills and faults.

The true temperatures lie close together, because the bodies exchange heat; that is what
makes sensors collinear, and nothing here adds to it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from app.simulation.undeclared.components import ASSIGNED_SENSORS, FloatArray
from app.simulation.undeclared.conditions import Conditions
from app.simulation.undeclared.history import SENSORS, History


@dataclass(frozen=True)
class Standstill:
    """A sensor whose readings stood still from one minute to another (not inclusive)."""

    sensor: str
    from_min: float
    to_min: float


@dataclass(frozen=True)
class SensorRecord:
    """Readings of all sensors.

    Parameters
    ----------
    minutes : ndarray, shape (n,) [min]
        From 0, one minute apart.
    temperatures_c : mapping of sensor to ndarray, shape (n,) [°C]
        What is transmitted.
    standstills
        When a sensor stood still.
    """

    minutes: FloatArray
    temperatures_c: dict[str, FloatArray]
    standstills: tuple[Standstill, ...]

    def at(self, sensor: str, time_min: FloatArray) -> FloatArray:
        """Interpolate a sensor's readings linearly in time [°C]."""
        return np.interp(time_min, self.minutes, self.temperatures_c[sensor])


def read_sensors(
    rng: np.random.Generator,
    history: History,
    conditions: Conditions,
    faulty_c: dict[str, FloatArray],
    visit_starts_min: FloatArray,
) -> SensorRecord:
    """Read all sensors every minute.

    Parameters
    ----------
    faulty_c : mapping of sensor to ndarray, shape (n,) [°C]
        What a faulty sensor shows instead of the truth, in all minutes of the history.
    visit_starts_min : ndarray, shape (v,) [min]
        Stand-stills are chosen so that each covers a visit's beginning.
    """
    minutes = history.since_first_reading(history.minutes)
    noise = rng.standard_normal((len(SENSORS), minutes.size)) * conditions.sensor_noise_c
    read_c = {}
    for sensor, of_sensor in zip(SENSORS, noise, strict=True):
        sensor_c = history.since_first_reading(faulty_c.get(sensor, history.temperatures_c[sensor]))
        is_still = np.zeros(sensor_c.shape, dtype=bool)
        if sensor in faulty_c:
            is_still[1:] = np.diff(sensor_c) == 0
        read_c[sensor] = _rounded(_hold(sensor_c + of_sensor, is_still), conditions.quantum_c)
    standstills = tuple(
        _standstill(rng, visit_starts_min, minutes) for _ in range(conditions.frozen)
    )
    for still in standstills:
        frozen = (minutes > still.from_min) & (minutes < still.to_min)
        read_c[still.sensor] = _hold(read_c[still.sensor], frozen)
    return SensorRecord(minutes, read_c, standstills)


def _rounded(values: FloatArray, quantum_c: float) -> FloatArray:
    """Round to multiples of a quantum, free of binary dust."""
    if quantum_c <= 0:
        return values
    return np.round(np.round(values / quantum_c) * quantum_c, 6)


def _hold(values: FloatArray, is_still: np.ndarray) -> FloatArray:
    """Repeat the last value that was not held."""
    place = np.where(is_still, 0, np.arange(values.size))
    return values[np.maximum.accumulate(place)]


def _standstill(
    rng: np.random.Generator, visit_starts_min: FloatArray, minutes: FloatArray
) -> Standstill:
    begins = float(rng.choice(visit_starts_min)) - rng.uniform(10.0, 60.0)
    ends = begins + rng.uniform(120.0, 360.0)
    sensor = str(rng.choice(ASSIGNED_SENSORS))
    return Standstill(sensor, max(np.floor(begins), 0.0), min(np.floor(ends), float(minutes[-1])))
