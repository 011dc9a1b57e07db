"""How fast a sensor's temperature changes now, of readings that need not lie on a straight line."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.arrays import FloatArray, rms
from app.units import SECONDS_PER_H

LONGEST_S: Final = 1800.0
"""Over how long a rate is taken, at most [s]."""

SHORTEST_S: Final = 180.0
"""Over how long at least [s]: of a shorter time the steps of the sensor are the rate."""

BENT: Final = 2.0
"""A course is bent where a straight line misses it by so many times its scatter or resolution."""

FEWEST: Final = 3
"""Readings of which a rate is taken."""


def rate_k_per_h(times_s: FloatArray, values_c: FloatArray, resolution_c: float) -> float | None:
    """Say how fast a temperature changes at its last reading.

    A straight line through the last half hour. Where the temperature turned or bent meanwhile,
    that line tells of no moment of it, so the time is halved until a line fits, down to 3 min.

    Parameters
    ----------
    times_s, values_c : ndarray, shape (n,) [s], [°C]
        Readings of the sensor in order of time.
    resolution_c
        What a line may always miss by [°C].

    Returns
    -------
    float or None [K/h]
        None where fewer than three readings, or less than 3 min of them, are there.

    Examples
    --------
    Warmer by 1 K an hour:

    >>> minutes = np.arange(31.0)
    >>> rate_k_per_h(minutes * 60.0, 20.0 + minutes / 60.0, 0.1)
    1.0

    A peak a quarter of an hour ago: the line through all of it would be level.

    >>> rate_k_per_h(minutes * 60.0, 20.0 - abs(minutes - 15.0), 0.1)
    -60.0
    """
    if times_s.size == 0:
        return None
    slope, over_s = None, LONGEST_S
    allowed_c = BENT * max(resolution_c, _scatter(*_last(times_s, values_c, LONGEST_S)))
    while over_s >= SHORTEST_S:
        times, values = _last(times_s, values_c, over_s)
        if times.size < FEWEST or times[-1] - times[0] < SHORTEST_S:
            break
        t, v = times - times.mean(), values - values.mean()
        slope = float(t @ v / (t @ t))
        if rms(v - slope * t) <= allowed_c:
            break
        over_s /= 2.0
    return None if slope is None else round(slope * SECONDS_PER_H, 3) + 0.0


def _last(
    times_s: FloatArray, values_c: FloatArray, over_s: float
) -> tuple[FloatArray, FloatArray]:
    recent = times_s >= times_s[-1] - over_s
    return times_s[recent], values_c[recent]


def _scatter(times_s: FloatArray, values_c: FloatArray) -> float:
    """Standard deviation of single readings [K], by what each is beside the line of its neighbours.

    A course that bends slowly adds hardly anything to it, unlike to what is left of one line.
    """
    if times_s.size < FEWEST:
        return 0.0
    before, at, after = times_s[:-2], times_s[1:-1], times_s[2:]
    share = (at - before) / (after - before)
    beside = values_c[1:-1] - (1.0 - share) * values_c[:-2] - share * values_c[2:]
    # Three readings of the same noise are in it, with these weights.
    of_one = beside / np.sqrt(1.0 + share**2 + (1.0 - share) ** 2)
    return rms(of_one)
