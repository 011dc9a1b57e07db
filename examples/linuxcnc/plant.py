"""The plant behind the motors: what its sensors read, and where it stands. Nobody declares it.

X is driven by a screw that grows with its temperature, has a periodic error and loses 4 µm at a
reversal. Z stands on a column that grows as its sensor does, but 40 minutes late.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from examples.linuxcnc.controller import Rest

SENSORS: Final = ("x-middle", "z-column")
STEP_S: Final = 60.0
HOUR_S: Final = 3600.0

ROOM_C: Final = 20.0
REVERSAL_UM: Final = 4.0
LATE_S: Final = 40 * 60.0
"""Time constant with which the column follows its sensor."""

READING_C: Final = 0.02
"""Standard deviation of a sensor's reading."""

LASER_UM: Final = 0.2
"""Standard deviation of the laser's readings in the workshop's campaign."""


def x_error_um(x_mm: float, way: int, screw_c: float) -> float:
    """Give the displacement of X, actual minus nominal, at its screw's temperature [µm]."""
    grown = 0.04 * (screw_c - 18.0) * x_mm + 2.5 * math.sin(x_mm / 14.0)
    return grown - (0.0 if way > 0 else REVERSAL_UM)


def z_error_um(z_mm: float, column_c: float) -> float:
    """Give the displacement of Z, actual minus nominal, at its column's own temperature [µm]."""
    return 0.011 * (column_c - 20.0) * z_mm + 3.0 * math.sin(z_mm / 95.0)


@dataclass(frozen=True, slots=True)
class Warmth:
    """What the sensors read at a time, and how warm the column itself is [°C]."""

    x_middle_c: float
    z_column_c: float
    column_c: float

    @classmethod
    def steady(cls, t_c: float) -> Warmth:
        """Stand at one temperature for long enough."""
        return cls(t_c, t_c, t_c)


def actual_mm(rest: Rest, warmth: Warmth) -> dict[str, float]:
    """Say where X and Z of the plant stand, with the motors where they are [mm]."""
    x, _, z = rest.motors_mm
    x_um = x_error_um(x, rest.ways[0], warmth.x_middle_c)
    return {"x": x + x_um / 1000.0, "z": z + z_error_um(z, warmth.column_c) / 1000.0}


@dataclass(frozen=True)
class Course:
    """The plant's temperatures through days of work, minute by minute.

    Parameters
    ----------
    times_s
        Seconds since 1970-01-01 UTC.
    """

    times_s: np.ndarray
    x_middle_c: np.ndarray
    z_column_c: np.ndarray
    column_c: np.ndarray

    @classmethod
    def of_work(cls, start_s: float, end_s: float, work_s: Sequence[tuple[float, float]]) -> Course:
        """Follow the spindle: it warms the headstock, that the column, that its foundation.

        Parameters
        ----------
        work_s
            From when to when the spindle turned [s].
        """
        times = np.arange(start_s, end_s, STEP_S)
        turns = np.zeros(times.shape)
        for begun, ended in work_s:
            turns[(times >= begun) & (times < ended)] = 1.0
        room = ROOM_C + 1.0 * np.sin((times - start_s) / (24 * HOUR_S) * 2 * np.pi)
        sensor = _late(room + 11.0 * turns, 25 * 60.0)
        screw = _late(room + 4.0 * turns, 70 * 60.0)
        return cls(times, screw, sensor, _late(sensor, LATE_S))

    def at(self, time_s: float) -> Warmth:
        """Give the temperatures at a time within the course."""
        rows = (self.x_middle_c, self.z_column_c, self.column_c)
        return Warmth(*(float(np.interp(time_s, self.times_s, row)) for row in rows))

    def read(self, seed: int) -> Iterator[tuple[float, dict[str, float]]]:
        """Give what the sensors read, minute by minute, with their scatter."""
        scatter = np.random.default_rng(seed).normal(0.0, READING_C, (len(self.times_s), 2))
        for time_s, x, z, (dx, dz) in zip(
            self.times_s, self.x_middle_c, self.z_column_c, scatter, strict=True
        ):
            read_c = (round(float(x + dx), 3), round(float(z + dz), 3))
            yield float(time_s), dict(zip(SENSORS, read_c, strict=True))


def _late(driver: np.ndarray, time_constant_s: float) -> np.ndarray:
    """Follow a driver that is held from minute to minute, from a long rest at its first value."""
    share = -math.expm1(-STEP_S / time_constant_s)
    found = np.empty(driver.shape)
    found[0] = driver[0]
    for number in range(1, len(driver)):
        found[number] = found[number - 1] + share * (driver[number - 1] - found[number - 1])
    return found
