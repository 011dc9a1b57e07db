"""Sensors that read in whole steps: what their temperature was between two of them.

A reading of whole degrees says little of the temperature while it stays, and nearly everything
when it changes: then the temperature passes the middle between two steps. So a record of coarse
readings is known better, looking back, than any one of them is when it comes.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from app.arrays import BoolArray, FloatArray, IntArray

COARSE_K: Final = 0.2
"""Steps from which a sensor counts as coarse [K]: by finer ones a table is hardly wrong."""

WRITTEN: Final = 3
"""Decimals to which readings count as the same."""

UNEVEN: Final = 0.01
"""Distances of readings are whole steps within this share of one."""

EACH_OFTEN: Final = 4
"""So often, in the mean, each value must have been read: a few may lie evenly by chance."""

FEWEST_VALUES: Final = 3

FURTHEST: Final = 0.7
"""Share of a step, at most, by which a temperature that turns within it is taken to enter it."""

SLOW_S: Final = 7200.0
"""A step takes so long where none was ever passed [s]."""


class Coarse(NamedTuple):
    """What a coarse sensor's readings say, looking back.

    Parameters
    ----------
    temperatures_c : ndarray, shape (n,) [°C]
        What it probably was at each reading, within half a step of it.
    stay : ndarray of int, shape (n,)
        For each reading the number of the stay, from 0: so long it has read the same.
    """

    step_k: float
    temperatures_c: FloatArray
    stay: IntArray

    @property
    def error_k(self) -> float:
        """Standard error of a reading, δ/√12 (JCGM 100:2008, F.2.2.1) [K].

        Looking back leaves between 0.45 of it, where the temperature passes steps evenly, and all
        of it, where it turns within them: no less is claimed.
        """
        return self.step_k / float(np.sqrt(12.0))


def step_k(temperatures_c: FloatArray) -> float:
    """Find the step in which a sensor reads [K]; 0 where it shows none that is coarse.

    Examples
    --------
    >>> step_k(np.repeat([20.0, 20.5, 21.5, 20.5], 4))
    0.5
    """
    values = np.round(temperatures_c[np.isfinite(temperatures_c)], WRITTEN)
    distinct = np.unique(values)
    if len(distinct) < FEWEST_VALUES or len(values) < EACH_OFTEN * len(distinct):
        return 0.0
    apart = np.diff(distinct)
    steps = apart / apart.min()
    if apart.min() < COARSE_K or np.abs(steps - np.round(steps)).max() > UNEVEN:
        return 0.0
    return float(np.round(apart.min(), WRITTEN))


def looking_back(
    times_s: FloatArray, temperatures_c: FloatArray, max_gap_s: float
) -> Coarse | None:
    """Say what a coarse sensor's temperature was between its steps; None of a fine one.

    Parameters
    ----------
    times_s, temperatures_c : ndarray, shape (n,) [s], [°C]
        All of its readings, none NaN, in order of time.
    max_gap_s
        A change between readings further apart does not say when it came [s].
    """
    step = step_k(temperatures_c)
    if not step:
        return None
    is_first = np.append(True, np.diff(temperatures_c) != 0.0)
    stay = np.cumsum(is_first) - 1
    first = np.flatnonzero(is_first)
    last = np.append(first[1:], len(temperatures_c)) - 1
    level, rise = temperatures_c[first], np.diff(temperatures_c[first])
    # A change by one step, seen as it came, tells when the middle between the two was passed.
    is_seen = (times_s[first[1:]] - times_s[last[:-1]] <= max_gap_s) & (
        np.abs(rise) < (1.0 + UNEVEN) * step
    )
    way = np.where(is_seen, np.sign(rise), 0.0)
    before, after = np.append(0.0, way), np.append(way, 0.0)
    is_open = before * after <= 0.0
    lasted_s = times_s[last] - times_s[first]
    # Where it turned it went on for a while as it had come: as a parabola does between the two
    # passages, at the rate of the stays beside it.
    # A parabola that enters a stay of length L at the rate r, and leaves it as fast, gets r L/4
    # further.
    beyond = np.minimum(FURTHEST * step, _rates(step, lasted_s, is_open) * lasted_s / 4.0)
    turned = np.where(before * after < 0.0, level - before * (0.5 * step - beyond), level)
    known_s = np.concatenate(
        [
            ((times_s[first[1:]] + times_s[last[:-1]]) / 2.0)[is_seen],
            ((times_s[first] + times_s[last]) / 2.0)[is_open],
        ]
    )
    known_c = np.concatenate([((level[:-1] + level[1:]) / 2.0)[is_seen], turned[is_open]])
    order = np.argsort(known_s, kind="stable")
    inside = np.clip(times_s, known_s[order[0]], known_s[order[-1]])
    # Monotone between what is known: a spline would swing beyond it, and invent a warmer moment.
    fitted = PchipInterpolator(known_s[order], known_c[order])(inside)
    fitted = np.clip(fitted, temperatures_c - step / 2.0, temperatures_c + step / 2.0)
    return Coarse(step, fitted, stay.astype(np.intp))


def _rates(step: float, lasted_s: FloatArray, is_open: BoolArray) -> FloatArray:
    """Say how fast the temperature passes the stays beside each one, shape (stays,) [K/s]."""
    passed = np.where(is_open | (lasted_s <= 0.0), np.nan, lasted_s)
    usual_s = np.nanmedian(passed) if np.isfinite(passed).any() else SLOW_S
    beside = np.stack([np.append(np.nan, passed[:-1]), np.append(passed[1:], np.nan)])
    count = np.isfinite(beside).sum(axis=0)
    lasted = np.where(count > 0, np.nansum(beside, axis=0) / np.maximum(count, 1), usual_s)
    rates: FloatArray = step / lasted
    return rates
