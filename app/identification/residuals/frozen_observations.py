"""Observations of an instrument, or of its log, that stood still while the machine did not.

A stopped measurement repeats its last value in all its channels, to the last digit. One
channel of a coarse instrument may do so too, and so may a machine at rest: neither counts.
Only repeats at one place are looked at: another place is another measurement.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray
from app.effects.conditions import Conditions
from app.effects.observations import ObservationRows

FROZEN: Final = "the instrument repeated one value"
"""Why such a row takes no part."""

FROZEN_S: Final = 600.0
"""A value that is repeated for longer than this is not a measured one [s]."""

FEWEST_REPEATS: Final = 3
FEWEST_TOGETHER: Final = 2
"""So many times in a row, at least; where several channels repeat together, to the last digit."""

FRESH_S: Final = 300.0
"""The first of the repeated values is a measured one, but nobody knows of when: if the observation
before is longer ago than this, it takes no part either [s]."""

MOVED_K: Final = 1.0
"""Some temperature must have moved by more than this meanwhile [K]: a sensor of whole degrees ticks
by as much."""


def frozen_rows(rows: ObservationRows, conditions: Conditions) -> BoolArray:
    """Find observations that only repeat an instrument's last value.

    Returns
    -------
    ndarray, shape (n,)
        True from the second one of each repeated value on, from the first where observations are
        rare; never for the first observation of all, and where nothing was measured yet.
    """
    frozen = np.zeros(len(rows), dtype=np.bool_)
    for which in np.unique(rows.verification[~rows.is_planned]).tolist():
        of_verification = np.flatnonzero(rows.verification == which)
        times_s, moment = np.unique(rows.times_s[of_verification], return_inverse=True)
        stands = _stands_still(rows, of_verification, moment, len(times_s))
        for first, last in _stretches(stands):
            here = of_verification[(moment >= first) & (moment <= last)]
            is_alone = np.unique(rows.channel[here]).size == 1
            fewest = FEWEST_REPEATS if is_alone else FEWEST_TOGETHER
            long = times_s[last] - times_s[first] > FROZEN_S and last - first + 1 >= fewest
            if long and _moved_k(conditions, here) > MOVED_K:
                is_old = first > 0 and times_s[first] - times_s[first - 1] > FRESH_S
                frozen[of_verification[(moment > first - is_old) & (moment <= last)]] = True
    return frozen


def _stands_still(
    rows: ObservationRows, chosen: IntArray, moment: IntArray, count: int
) -> BoolArray:
    """Say of each moment whether all its values and places are those of the moment before."""
    stands = np.ones(count, dtype=np.bool_)
    stands[0] = False
    for channel in np.unique(rows.channel[chosen]).tolist():
        mine = rows.channel[chosen] == channel
        values: FloatArray = np.full(count, np.nan)
        values[moment[mine]] = rows.measured[chosen[mine]]
        places = np.full((count, 3), np.nan)
        places[moment[mine]] = rows.points_mm[chosen[mine]]
        moved = np.diff(np.nan_to_num(places), axis=0).any(axis=1)
        same = (np.diff(values) == 0.0) & ~moved
        stands[1:] &= same | np.isnan(values[1:])
    return stands


def _stretches(stands: BoolArray) -> Sequence[tuple[int, int]]:
    """List first and last of each stretch of one value.

    >>> _stretches(np.array([False, True, True, False, False, True]))
    [(0, 2), (4, 5)]
    """
    starts = np.flatnonzero(~stands)
    ends = np.append(starts[1:], stands.size) - 1
    return [(int(a), int(b)) for a, b in zip(starts, ends, strict=True) if b > a]


def _moved_k(conditions: Conditions, rows: IntArray) -> float:
    """Give the largest span of any temperature over some rows [K]."""
    spans = [0.0]
    for values in conditions.temperatures_c.values():
        present = values[rows][~np.isnan(values[rows])]
        if present.size:
            spans.append(float(np.ptp(present)))
    return max(spans)
