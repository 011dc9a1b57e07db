"""Sensors that left their neighbours for good: a failure that no single reading betrays.

Heat comes and goes, so that a sensor's distance from its neighbours has a usual range. A
sensor that from some hour on never comes back into that range, and whose new range lies
several widths off, reads wrong, or something new heats its place alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.thermal.temperature_history import TemperatureHistory
from app.units import SECONDS_PER_DAY

BLOCK_S: Final = 3600.0
"""Readings of one hour count once [s]."""

FEWEST_BLOCKS: Final = 6
"""Hours that are needed on either side of a change."""

FEWEST_DAYS: Final = 2
"""Days that are needed on either side: a day's work is no failure."""

FEWEST_SENSORS: Final = 4
"""Of three, one cannot be told from the other two with any safety."""

WIDTHS: Final = 3.0
"""Widths of its usual range by which a sensor must have moved."""

LEAST_K: Final = 2.0
"""Smaller changes are left to the observations to show [K]."""

USUAL: Final = (0.05, 0.95)
"""Quantiles that bound a usual range."""


@dataclass(frozen=True, slots=True)
class DoubtfulSensor:
    """A sensor that left its neighbours.

    Parameters
    ----------
    since_s
        End of the last hour in which it was where it used to be [s since 1970].
    off_by_k
        How far it has moved against them [K].
    usual_k
        Width of the range in which its distance from them used to lie [K].
    """

    sensor: str
    since_s: float
    off_by_k: float
    usual_k: float


def doubtful_sensors(history: TemperatureHistory) -> list[DoubtfulSensor]:
    """Find sensors that left their neighbours for good.

    Each sensor is compared hour by hour with each other one. The middle one of these
    distances, each counted from its own median, is the sensor's own movement as long as
    most of the others are sound.

    Returns
    -------
    list of DoubtfulSensor
        In the order of the history.

    Examples
    --------
    >>> hours = 3600.0 * np.arange(240)
    >>> day = 20.0 + 2.0 * np.sin(2 * np.pi * hours / 86400.0)
    >>> failed = day + 15.0 * (hours > 432000.0)
    >>> found = doubtful_sensors(
    ...     TemperatureHistory(hours, {"a": day, "b": day + 1.0, "c": 0.9 * day, "d": failed}))
    >>> [(one.sensor, round(one.off_by_k)) for one in found]
    [('d', 15)]
    """
    names = list(history.temperatures_c)
    if len(names) < FEWEST_SENSORS or not history.times_s.size:
        return []
    starts_s, means = _blocks(history, names)
    doubts = []
    for i, name in enumerate(names):
        present = ~np.isnan(means[:, i])
        moved = _own_movement(means[present], i)
        usable = ~np.isnan(moved)
        change = _change(starts_s[present][usable], moved[usable])
        if change is not None:
            doubts.append(DoubtfulSensor(name, *change))
    return doubts


def without_doubtful(
    history: TemperatureHistory, doubtful: Sequence[DoubtfulSensor]
) -> TemperatureHistory:
    """Leave out what doubtful sensors read since they left their neighbours.

    Returns
    -------
    TemperatureHistory
        The same times, NaN there.
    """
    since_s = {doubt.sensor: doubt.since_s for doubt in doubtful}
    return TemperatureHistory(
        history.times_s,
        {
            name: np.where(history.times_s >= since_s.get(name, np.inf), np.nan, values)
            for name, values in history.temperatures_c.items()
        },
    )


def _blocks(history: TemperatureHistory, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    """Average hour by hour: starts, shape (b,) [s], and means, shape (b, sensors) [°C]."""
    hours = np.floor(history.times_s / BLOCK_S)
    first = np.flatnonzero(np.concatenate([[True], np.diff(hours) > 0]))
    values = np.column_stack([history.temperatures_c[name] for name in names])
    present = ~np.isnan(values)
    sums = np.add.reduceat(np.where(present, values, 0.0), first, axis=0)
    counts = np.add.reduceat(present.astype(float), first, axis=0)
    means = np.divide(sums, counts, out=np.full(sums.shape, np.nan), where=counts > 0)
    return hours[first] * BLOCK_S, means


def _own_movement(means: FloatArray, sensor: int) -> FloatArray:
    """Give a sensor's movement against the middle one of the others, shape (b,) [K]."""
    apart = means[:, [sensor]] - np.delete(means, sensor, axis=1)
    apart = apart[:, ~np.isnan(apart).all(axis=0)]
    if apart.shape[1] < FEWEST_SENSORS - 1 or not len(apart):
        return np.full(len(means), np.nan)
    apart = apart - np.nanmedian(apart, axis=0)
    enough = (~np.isnan(apart)).sum(axis=1) >= FEWEST_SENSORS - 1
    movement = np.full(len(means), np.nan)
    movement[enough] = np.nanmedian(apart[enough], axis=1)
    return movement


def _change(starts_s: FloatArray, moved: FloatArray) -> tuple[float, float, float] | None:
    """Find the hour from which on a sensor is elsewhere: since [s], by [K], usual width [K]."""
    at = _cut(moved)
    enough = FEWEST_BLOCKS <= at <= len(moved) - FEWEST_BLOCKS
    if not enough or min(_days(starts_s[:at]), _days(starts_s[at:])) < FEWEST_DAYS:
        return None
    before, after = moved[:at], moved[at:]
    usual_k = _width(before)
    by_k = float(np.median(after) - np.median(before))
    if abs(by_k) < max(LEAST_K, WIDTHS * max(usual_k, _width(after))):
        return None
    # A sensor that fails slowly has left its range some hours before.
    still = np.abs(before - np.median(before)) <= max(usual_k, LEAST_K / 2.0)
    return float(starts_s[np.flatnonzero(still)[-1]] + BLOCK_S), by_k, usual_k


def _cut(moved: FloatArray) -> int:
    """Say where a step would be: where the sum of deviations from the mean turns."""
    if moved.size < 2:
        return 0
    # Before a step all lie on one side of the mean, behind it on the other: the running sum goes
    # one way up to it, and back from there. Clipped, so that single hours do not decide.
    clipped = np.clip(moved, *np.quantile(moved, USUAL))
    return int(np.argmax(np.abs(np.cumsum(clipped - clipped.mean())[:-1]))) + 1


def _width(values: FloatArray) -> float:
    low, high = np.quantile(values, USUAL)
    return float(high - low)


def _days(starts_s: FloatArray) -> int:
    return int(np.unique(np.floor(starts_s / SECONDS_PER_DAY)).size)
