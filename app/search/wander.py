"""How an instrument and a machine wander within one set-up: a covariance in time.

White noise, a wander that forgets exponentially (Ornstein-Uhlenbeck) and a smooth one (Matérn
3/2) add up. Where a set-up was zeroed at its first observation, what is left is their difference
from that observation, the noise of the zero included.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray

ROOT_3: Final = float(np.sqrt(3.0))


class Wander(NamedTuple):
    """White noise and two wanders.

    Parameters
    ----------
    white
        Standard deviation of one observation [the values' unit].
    rough, rough_min
        Standard deviation and time constant [min] of the wander that forgets exponentially.
    smooth, smooth_min
        The same of the smooth one.
    """

    white: float
    rough: float
    rough_min: float
    smooth: float
    smooth_min: float

    def larger(self, by: float) -> Wander:
        """Multiply all variances by a number."""
        root = float(np.sqrt(by))
        return self._replace(
            white=root * self.white, rough=root * self.rough, smooth=root * self.smooth
        )

    def over(self, apart_min: FloatArray) -> FloatArray:
        """Give the covariance of the wander at two times that lie so far apart [min].

        Examples
        --------
        >>> both = Wander(1.0, 3.0, 60.0, 4.0, 60.0)
        >>> both.over(np.array([0.0, 1e6])).tolist()
        [25.0, 0.0]
        """
        apart = np.abs(apart_min)
        scaled = ROOT_3 * apart / self.smooth_min
        rough = self.rough**2 * np.exp(-apart / self.rough_min)
        found: FloatArray = rough + self.smooth**2 * (1.0 + scaled) * np.exp(-scaled)
        return found

    def covariance(self, times_min: FloatArray, is_zeroed: BoolArray) -> FloatArray:
        """Give the covariance of n observations in each of m set-ups.

        Parameters
        ----------
        times_min : ndarray, shape (m, n) [min]
            When; of a zeroed set-up since its zero.
        is_zeroed : ndarray, shape (m,)
            Whether the observation at time 0 was subtracted from all others.

        Returns
        -------
        ndarray, shape (m, n, n)
        """
        return _of_set_up(self.over, self.white**2, times_min, is_zeroed)

    def slopes(self, times_min: FloatArray, is_zeroed: BoolArray) -> list[FloatArray]:
        """Give the slopes of `covariance` in the logarithms of the five parameters."""

        def rough(apart: FloatArray) -> FloatArray:
            found: FloatArray = self.rough**2 * np.exp(-apart / self.rough_min)
            return found

        def smooth(apart: FloatArray) -> FloatArray:
            scaled = ROOT_3 * apart / self.smooth_min
            found: FloatArray = self.smooth**2 * np.exp(-scaled)
            return found

        def scaled(apart: FloatArray) -> FloatArray:
            return ROOT_3 * apart / self.smooth_min

        parts: list[tuple[Callable[[FloatArray], FloatArray], float]] = [
            (np.zeros_like, 2.0 * self.white**2),
            (lambda d: 2.0 * rough(d), 0.0),
            (lambda d: rough(d) * d / self.rough_min, 0.0),
            (lambda d: 2.0 * smooth(d) * (1.0 + scaled(d)), 0.0),
            (lambda d: smooth(d) * scaled(d) ** 2, 0.0),
        ]
        return [_of_set_up(over, white, times_min, is_zeroed) for over, white in parts]

    def variance(self, times_min: FloatArray, *, is_zeroed: bool) -> FloatArray:
        """Give what the wander alone makes uncertain at n times, shape (n,), without the noise."""
        here: FloatArray = np.broadcast_to(self.over(np.zeros(1)), times_min.shape)
        return 2.0 * (here - self.over(times_min)) if is_zeroed else here


def _of_set_up(
    over: Callable[[FloatArray], FloatArray],
    white: float,
    times_min: FloatArray,
    is_zeroed: BoolArray,
) -> FloatArray:
    """Make covariances of set-ups from that over a time, those of differences where zeroed."""
    found = over(np.abs(times_min[:, :, None] - times_min[:, None, :]))
    own = np.arange(times_min.shape[1])
    found[:, own, own] += white
    if is_zeroed.any():
        to_zero = np.where(is_zeroed[:, None], over(np.abs(times_min)), 0.0)
        at_zero = np.where(is_zeroed, float(over(np.zeros(1))[0]) + white, 0.0)
        found += at_zero[:, None, None] - to_zero[:, :, None] - to_zero[:, None, :]
    return found
