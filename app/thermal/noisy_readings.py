"""Sensors whose single readings scatter: what their temperature was, looking back.

A body does not jump back and forth from one reading to the next. What single readings scatter by
is the sensor's own, and all components that follow it would be off by it together. The mean of
readings before and after, along a straight line, is better known than each of them.

T. Gasser, L. Sroka, C. Jennen-Steinmetz, Biometrika 73 (1986) 625: scatter from second differences.
W. Cleveland, J. Am. Stat. Assoc. 74 (1979) 829: local straight lines.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray, robust_sd
from app.units import SECONDS_PER_MIN

NOISY_K: Final = 0.1
"""Scatter of single readings from which a sensor counts as noisy [K]: by less a table is hardly
wrong."""

MOST_ALIKE: Final = -0.58
"""Correlation of neighbouring second differences, at most: −2/3 where readings scatter by
themselves, −1/2 where a temperature walks as a room's does, positive where it bends."""

FEWEST_READINGS: Final = 50

HALF_WIDTHS_MIN: Final = (2.0, 4.0, 6.0, 10.0, 15.0, 22.0, 32.0, 45.0)
"""Readings within so long before and after are tried."""

MOST_OWN: Final = 0.5
"""Where a reading weighs more than this in its own mean, too few are near to say what scatters."""

BENT: Final = 0.25
"""At the width that misses least, what lines miss because a temperature bends, in the variance of
their own error: both grow at the rates that make the sum least (fourth power and inverse)."""


class Noisy(NamedTuple):
    """What a noisy sensor's readings say, looking back.

    Parameters
    ----------
    scatter_k
        Standard deviation of single readings [K].
    temperatures_c : ndarray, shape (n,) [°C]
        What it probably was at each reading.
    stay : ndarray of int, shape (n,)
        For each reading the number of the stretch, from 0, of which the mean is off together.
    error_k
        Standard error of that mean [K].
    """

    scatter_k: float
    temperatures_c: FloatArray
    stay: IntArray
    error_k: float


def scatter_k(times_s: FloatArray, temperatures_c: FloatArray, max_gap_s: float) -> float:
    """Find how much single readings scatter [K]; 0 where that is not clearly the sensor's own.

    Examples
    --------
    >>> times_s = np.arange(400.0) * 60.0
    >>> noise = np.random.default_rng(1).normal(0.0, 0.3, 400)
    >>> round(scatter_k(times_s, 20.0 + noise, 600.0), 1)
    0.3
    """
    if len(times_s) < FEWEST_READINGS:
        return 0.0
    gaps_s = np.diff(times_s)
    before = gaps_s[1:] / (gaps_s[:-1] + gaps_s[1:])
    between = before * temperatures_c[:-2] + (1.0 - before) * temperatures_c[2:]
    apart = temperatures_c[1:-1] - between
    # Of three readings that scatter by 1 each, the middle one scatters by so much about the line
    # through the other two, wherever between them it lies.
    apart = apart / np.sqrt(1.0 + before**2 + (1.0 - before) ** 2)
    near = (gaps_s <= max_gap_s)[:-1] & (gaps_s <= max_gap_s)[1:]
    if near.sum() < FEWEST_READINGS:
        return 0.0
    spread = robust_sd(apart[near])
    pairs = near[:-1] & near[1:]
    # Few far values would decide a correlation of the values themselves.
    usual = np.clip(apart, -3.0 * spread, 3.0 * spread)
    alike = float(np.sum(usual[:-1][pairs] * usual[1:][pairs]))
    squares = float(np.mean(usual[near] ** 2)) * pairs.sum()
    return spread if squares > 0.0 and alike <= MOST_ALIKE * squares else 0.0


def without_noise(
    times_s: FloatArray, temperatures_c: FloatArray, max_gap_s: float
) -> Noisy | None:
    """Say what a noisy sensor's temperature was; None of a quiet one.

    Parameters
    ----------
    times_s, temperatures_c : ndarray, shape (n,) [s], [°C]
        All of its readings, none NaN, in order of time.
    max_gap_s
        Readings further apart say nothing of each other [s].
    """
    scatter = scatter_k(times_s, temperatures_c, max_gap_s)
    if scatter < NOISY_K:
        return None
    apart = np.append(True, np.diff(times_s) > max_gap_s)
    stretch = np.cumsum(apart) - 1
    lines = [
        _local_lines(times_s, temperatures_c, stretch, minutes * SECONDS_PER_MIN)
        for minutes in HALF_WIDTHS_MIN
    ]
    best = min(range(len(lines)), key=lambda i: lines[i].missed)
    chosen, width_s = lines[best], 2.0 * HALF_WIDTHS_MIN[best] * SECONDS_PER_MIN
    begins = np.floor((times_s - times_s[0]) / width_s)
    stay = np.cumsum(apart | np.append(True, np.diff(begins) > 0)) - 1
    share = float(np.median(chosen.own_share))
    if share > MOST_OWN:
        return None
    error = scatter * float(np.sqrt(share * (1.0 + BENT)))
    return Noisy(scatter, chosen.values, stay.astype(np.intp), error)


class _Lines(NamedTuple):
    """Straight lines through the readings around each one."""

    values: FloatArray
    own_share: FloatArray
    missed: float
    """Mean square by which lines miss a reading that took no part in them [K²]."""


def _local_lines(
    times_s: FloatArray, temperatures_c: FloatArray, stretch: IntArray, half_s: float
) -> _Lines:
    """Fit a straight line around each reading, by sums that run along the record."""
    n = len(times_s)
    first_of, last_of = _ends(stretch)
    low = np.maximum(np.searchsorted(times_s, times_s - half_s, "left"), first_of)
    high = np.minimum(np.searchsorted(times_s, times_s + half_s, "right"), last_of + 1)
    # Around a level and a time in the middle of the record, so that sums stay small.
    level, middle = float(np.mean(temperatures_c)), float(np.mean(times_s))
    t, y = (times_s - middle) / half_s, temperatures_c - level
    sums = [np.concatenate([[0.0], np.cumsum(v)]) for v in (np.ones(n), t, t * t, y, t * y)]
    count, st, stt, sy, sty = (s[high] - s[low] for s in sums)
    mean_t, mean_y = st / count, sy / count
    spread = np.maximum(stt - count * mean_t**2, 0.0)
    is_line: BoolArray = (count >= 3) & (spread > 1e-9)
    slope = np.where(is_line, (sty - st * mean_y) / np.where(is_line, spread, 1.0), 0.0)
    away = t - mean_t
    values = mean_y + slope * away
    share = 1.0 / count + np.where(is_line, away**2 / np.where(is_line, spread, 1.0), 0.0)
    alone = count < 3
    values = np.where(alone, y, values)
    # A reading weighs `share` in the line at its own place: divided by the rest, its distance is
    # that from the line of the others, which is never made.
    others = np.where(alone, 1.0, 1.0 - np.minimum(share, 0.999))
    missed = np.where(alone, np.nan, ((y - values) / others) ** 2)
    mean = float(np.nanmean(missed)) if np.isfinite(missed).mean() > 0.5 else np.inf
    return _Lines(values + level, np.where(alone, 1.0, share), mean)


def _ends(stretch: IntArray) -> tuple[IntArray, IntArray]:
    """Give the first and the last reading of each reading's stretch."""
    numbers = np.arange(stretch[-1] + 1)
    first, last = np.searchsorted(stretch, numbers), np.searchsorted(stretch, numbers, "right") - 1
    return first[stretch], last[stretch]
