"""Temperatures over a long time: of each bin the extremes, the mean, and the longest gap."""

from __future__ import annotations

from enum import IntEnum
from typing import Final

import numpy as np

from app.arrays import FloatArray


class Part(IntEnum):
    """What a row of bins has in its columns."""

    START = 0
    """[s] since 1970, a multiple of the width"""
    LOW = 1
    """[°C]"""
    HIGH = 2
    MEAN = 3
    COUNT = 4
    """Readings"""
    FIRST = 5
    """Time of the first reading [s]"""
    LAST = 6
    GAP = 7
    """Longest time between two neighbouring readings, of which the second is in the bin [s]"""


PARTS: Final = len(Part)

WIDTHS_S: Final = (
    *(1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1200, 1800),
    *(3600, 7200, 10_800, 21_600, 43_200, 86_400, 172_800, 604_800),
)
"""Of bins [s]: each divides an hour, or is a number of hours."""


def width_for(span_s: float, points: int) -> int:
    """Choose the narrowest bins of which so many cover a span [s].

    >>> width_for(3600.0, 1000), width_for(366 * 86400.0, 1000)
    (5, 43200)
    """
    return next((w for w in WIDTHS_S if span_s / w <= points), WIDTHS_S[-1])


def no_bins() -> FloatArray:
    """Give no bins: shape (0, 8)."""
    return np.empty((0, PARTS))


def merge_bins(bins: FloatArray, width_s: float) -> FloatArray:
    """Put bins together into wider ones.

    Parameters
    ----------
    bins : ndarray, shape (n, 8)
        In order of time, each with at least one reading.
    width_s
        Of the wider ones, a multiple of theirs [s].

    Returns
    -------
    ndarray, shape (m, 8)
        Those that have readings.
    """
    if not len(bins):
        return no_bins()
    starts = np.floor(bins[:, Part.START] / width_s) * width_s
    firsts = np.flatnonzero(np.diff(starts, prepend=-np.inf) > 0.0)
    counts = np.add.reduceat(bins[:, Part.COUNT], firsts)
    sums = np.add.reduceat(bins[:, Part.COUNT] * bins[:, Part.MEAN], firsts)
    gaps = bins[:, Part.GAP].copy()
    # A gap counts in the bin in which it ends.
    between = bins[1:, Part.FIRST] - bins[:-1, Part.LAST]
    gaps[1:] = np.maximum(gaps[1:], between)
    return np.column_stack(
        [
            starts[firsts],
            np.minimum.reduceat(bins[:, Part.LOW], firsts),
            np.maximum.reduceat(bins[:, Part.HIGH], firsts),
            sums / counts,
            counts,
            np.minimum.reduceat(bins[:, Part.FIRST], firsts),
            np.maximum.reduceat(bins[:, Part.LAST], firsts),
            np.maximum.reduceat(gaps, firsts),
        ]
    )
