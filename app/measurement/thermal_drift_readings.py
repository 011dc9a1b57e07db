"""What a nest of displacement sensors read: checked, as courses of displacements and tilts.

The first step of `app.measurement.thermal_drift`, which evaluates these courses.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray, IntArray
from app.errors import InvalidContent, counted, list_names
from app.geometry.components import LINEAR_LETTERS
from app.measurement.stated_numbers import FARTHEST_MM, as_numbers
from app.measurement.stated_runs import expect_linear_axis
from app.thermal.error_map import LARGEST_ERROR_UM
from app.units import UM_PER_MM, URAD_PER_RAD


class DriftTest(StrEnum):
    """What moves or changes while the nest is read."""

    ENVIRONMENT = "environment"
    SPINDLE = "spindle"
    LINEAR_AXIS = "linear-axis"


SENSORS: Final = ("x", "y", "z", "x2", "y2")
"""Of the nest: x2 and y2 read further along Z, and with x and y the tilts."""

UNITS: Final[Mapping[str, str]] = {"x": "um", "y": "um", "z": "um", "a": "urad", "b": "urad"}
"""What the sensors show: displacements [µm], tilts about X and Y [µrad]."""

MOST_TARGETS: Final = 20
"""Of a moving axis: further ones are a measurement of positioning, which has its own method."""

_FEWEST_FOR_NOISE: Final = 8
_NORMAL_QUARTILE: Final = 0.6745
"""The median of |v| over the standard deviation of a normal v."""

_URAD_PER_UM_PER_MM: Final = URAD_PER_RAD / UM_PER_MM


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """One displacement or tilt at one target, from the first reading there.

    Parameters
    ----------
    times_s : ndarray, shape (n,) [s]
        Strictly increasing.
    values : ndarray, shape (n,) [µm; µrad]
        Readings less the first one.
    noise
        Standard deviation of one reading, where it is known [µm; µrad].
    """

    times_s: FloatArray
    values: FloatArray
    noise: float | None

    def at(self, time_s: float) -> float:
        """Interpolate in time; before the first and after the last reading these count."""
        return float(np.interp(time_s, self.times_s, self.values))

    def variance_at(self, time_s: float) -> float | None:
        """Give the variance of the value at a time, of its own readings and of the zero."""
        if self.noise is None:
            return None
        share = np.zeros(self.times_s.size)
        after = int(np.clip(np.searchsorted(self.times_s, time_s), 1, self.times_s.size - 1))
        start, end = self.times_s[after - 1], self.times_s[after]
        weight = float(np.clip((time_s - start) / (end - start), 0.0, 1.0))
        share[after - 1], share[after] = 1.0 - weight, weight
        share[0] -= 1.0
        return self.noise**2 * float(share @ share)

    def range_within(self, since_s: float, until_s: float) -> float:
        """Give the largest value less the smallest between two times, both included."""
        inside = self.values[(self.times_s > since_s) & (self.times_s < until_s)]
        return float(np.ptp([self.at(since_s), *inside, self.at(until_s)]))


@dataclass(frozen=True, slots=True, eq=False)
class NestReadings:
    """Checked readings.

    Parameters
    ----------
    times_s : ndarray, shape (n,) [s]
        Strictly increasing.
    read
        Displacement (`x`, `y`, `z`) [µm] or tilt (`a`, `b`) [µrad] to its values, shape (n,).
    targets_mm : ndarray, shape (m,) [mm]
        Positions of the moving axis, rising; empty where nothing moved.
    target_of : ndarray, shape (n,)
        Number of the target at which each was read, 0 where nothing moved.
    """

    times_s: FloatArray
    read: Mapping[str, FloatArray]
    targets_mm: FloatArray
    target_of: IntArray


def read_nest(
    test: DriftTest,
    times_s: ArrayLike,
    displacements_um: Mapping[str, ArrayLike],
    axis: str | None,
    positions_mm: ArrayLike | None,
    distance_mm: float | None,
) -> NestReadings:
    """Check the readings, and turn what two sensors of one direction read into tilts.

    Parameters
    ----------
    test, times_s, displacements_um, axis, positions_mm, distance_mm
        As in `app.measurement.thermal_drift.evaluate_thermal_drift`.

    Raises
    ------
    InvalidContent
        If readings are missing, not finite, too large or not in order of time, or what is stated
        does not belong to the test.
    """
    times = _checked_times(times_s)
    unknown = [name for name in displacements_um if name not in SENSORS]
    if unknown or not displacements_um:
        raise InvalidContent.of_field(
            "readings",
            f"expected displacements among {list_names(f'{name}_um' for name in SENSORS)}, got "
            f"{list_names(unknown) if unknown else 'none'}",
        )
    read: dict[str, FloatArray] = {}
    for name in (name for name in SENSORS if name in displacements_um):
        field = f"{name}_um"
        read[name] = as_numbers(
            field, displacements_um[name], "µm", LARGEST_ERROR_UM, "perhaps in nm"
        )
        if read[name].shape != times.shape:
            raise InvalidContent.of_field(
                field,
                f"expected {counted(times.size, 'reading')} in µm, one at each time, got an array "
                f"of shape {read[name].shape}",
            )
    targets, target_of = _targets(test, axis, positions_mm, times.size)
    return NestReadings(
        times, dict(_displacements_and_tilts(read, distance_mm)), targets, target_of
    )


def _checked_times(times_s: ArrayLike) -> FloatArray:
    """Check that there are readings, in order of time."""
    times = as_numbers("times_s", times_s, "s")
    if times.ndim != 1 or times.size < 2:
        raise InvalidContent.of_field(
            "readings", f"expected at least two readings over time, got {times.size}"
        )
    early = np.flatnonzero(np.diff(times) <= 0)
    if early.size:
        i = int(early[0])
        raise InvalidContent.of_field(
            f"readings.{i + 1}.time",
            "expected each reading later than the one before it, got one "
            f"{times[i] - times[i + 1]:g} s before it",
        )
    return times


def _displacements_and_tilts(
    read: Mapping[str, FloatArray], distance_mm: float | None
) -> Iterator[tuple[str, FloatArray]]:
    for name in LINEAR_LETTERS:
        if name in read:
            yield name, read[name]
    for tilt, first, second, sign in (("a", "y", "y2", -1.0), ("b", "x", "x2", 1.0)):
        if second not in read:
            continue
        if first not in read:
            raise InvalidContent.of_field(
                f"{second}_um", f"expected {first}_um beside {second}_um, got none"
            )
        if distance_mm is None or not 1.0 <= abs(distance_mm) <= FARTHEST_MM:
            raise InvalidContent.of_field(
                "sensor_distance_mm",
                f"expected how far along Z {second} reads from {first}, 1 mm or more with its "
                f"sign, got {'none' if distance_mm is None else f'{distance_mm:g} mm'}",
            )
        yield tilt, sign * (read[second] - read[first]) / distance_mm * _URAD_PER_UM_PER_MM


def _targets(
    test: DriftTest, axis: str | None, positions_mm: ArrayLike | None, count: int
) -> tuple[FloatArray, IntArray]:
    """Sort rows by where the moving axis stood."""
    if test is not DriftTest.LINEAR_AXIS:
        if axis is not None or positions_mm is not None:
            field = "axis" if axis is not None else "position_mm"
            raise InvalidContent.of_field(
                field, f"expected {field} of the test linear-axis alone, got it of {test}"
            )
        return np.zeros(0), np.zeros(count, dtype=np.intp)
    expect_linear_axis(axis or "")
    if positions_mm is None:
        raise InvalidContent.of_field(
            "position_mm", f"expected where axis {axis} stood at each reading in mm, got none"
        )
    places = as_numbers("position_mm", positions_mm, "mm", FARTHEST_MM, "perhaps in µm")
    if places.shape != (count,):
        raise InvalidContent.of_field(
            "position_mm", f"expected {counted(count, 'position')} in mm, got {places.size}"
        )
    targets, target_of, visits = np.unique(places, return_inverse=True, return_counts=True)
    if targets.size > MOST_TARGETS or visits.min() < 2:
        once = targets[visits < 2]
        got = f"{once[0]:g} mm once" if once.size else counted(targets.size, "position")
        raise InvalidContent.of_field(
            "position_mm",
            f"expected 1 to {MOST_TARGETS} positions, each visited again and again, got {got}; "
            "the positions are nominal ones",
        )
    return targets, target_of.astype(np.intp)


def courses_of(nest: NestReadings, values: FloatArray, spread: float | None) -> Iterator[Course]:
    """Part readings by target, each from its own first reading.

    Parameters
    ----------
    values : ndarray, shape (n,) [µm; µrad]
        One of the displacements or tilts.
    spread
        Standard deviation of one of them; None: from the readings [µm; µrad].
    """
    for target in range(max(nest.targets_mm.size, 1)):
        rows = nest.target_of == target
        times, course = nest.times_s[rows], values[rows] - values[rows][0]
        noise = spread if spread is not None else noise_between_neighbours(times, course)
        yield Course(times, course, noise)


def spread_of(name: str, spread_um: float | None, distance_mm: float | None) -> float | None:
    """Turn the repeatability of a displacement [µm] into that of what was read [µm; µrad].

    A tilt is the difference of two displacements over the distance between their sensors [mm].
    """
    if spread_um is None or UNITS[name] == "um" or distance_mm is None:
        return spread_um
    return math.sqrt(2.0) * spread_um / abs(distance_mm) * _URAD_PER_UM_PER_MM


def noise_between_neighbours(times_s: FloatArray, values: FloatArray) -> float | None:
    """Estimate a reading's standard deviation from how it departs from the line of its neighbours.

    The median of |departure| over what noise of 1 gives it: a drift that bends between three
    readings adds to it, single outliers do not.

    Parameters
    ----------
    times_s, values : ndarray, shape (n,)

    Returns
    -------
    float or None
        None where there are too few readings, or they do not show their noise.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> noise = noise_between_neighbours(np.arange(1e4), rng.normal(0.0, 2.0, 10_000))
    >>> abs(noise - 2.0) < 0.05
    True
    """
    if values.size < _FEWEST_FOR_NOISE:
        return None
    weight = (times_s[1:-1] - times_s[:-2]) / (times_s[2:] - times_s[:-2])
    departure = values[1:-1] - (1.0 - weight) * values[:-2] - weight * values[2:]
    unit = np.sqrt(1.0 + (1.0 - weight) ** 2 + weight**2)
    noise = float(np.median(np.abs(departure / unit))) / _NORMAL_QUARTILE
    return noise or None
