"""How an instrument and a machine wander within one record: a covariance in time.

White noise, a wander that forgets exponentially (Ornstein-Uhlenbeck) and a smooth one (Matérn
3/2) add up. Where a set-up was zeroed at its first observation, what is left is their difference
from that observation, the noise of the zero included.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from app.arrays import FloatArray

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
        result: FloatArray = rough + self.smooth**2 * (1.0 + scaled) * np.exp(-scaled)
        return result

    def covariance(self, times_min: FloatArray, *, is_zeroed: bool) -> FloatArray:
        """Give the covariance of n observations of one record, shape (n, n).

        Parameters
        ----------
        times_min : ndarray, shape (n,) [min]
            When; of a zeroed set-up since its zero.
        is_zeroed
            Whether the observation at time 0 was subtracted from all others.
        """
        return _of_record(self.over, self.white**2, times_min, is_zeroed=is_zeroed)

    def slopes(self, times_min: FloatArray, *, is_zeroed: bool) -> list[FloatArray]:
        """Give the slopes of `covariance` in the logarithms of the five parameters."""

        def rough(apart: FloatArray) -> FloatArray:
            result: FloatArray = self.rough**2 * np.exp(-apart / self.rough_min)
            return result

        def scaled(apart: FloatArray) -> FloatArray:
            return ROOT_3 * apart / self.smooth_min

        def smooth(apart: FloatArray) -> FloatArray:
            result: FloatArray = self.smooth**2 * np.exp(-scaled(apart))
            return result

        # Slopes in the logarithms: a size enters squared, so twice the part itself. With x = d/τ,
        # e^(−x) has the slope x e^(−x) in ln τ, and (1 + x) e^(−x) has x² e^(−x).
        parts: list[tuple[Callable[[FloatArray], FloatArray], float]] = [
            (np.zeros_like, 2.0 * self.white**2),
            (lambda d: 2.0 * rough(d), 0.0),
            (lambda d: rough(d) * d / self.rough_min, 0.0),
            (lambda d: 2.0 * smooth(d) * (1.0 + scaled(d)), 0.0),
            (lambda d: smooth(d) * scaled(d) ** 2, 0.0),
        ]
        return [_of_record(over, white, times_min, is_zeroed=is_zeroed) for over, white in parts]

    def variance(self, times_min: FloatArray, *, is_zeroed: bool) -> FloatArray:
        """Give what the wander makes uncertain at n times, shape (n,), without the noise."""
        here: FloatArray = np.broadcast_to(self.over(np.zeros(1)), times_min.shape)
        return 2.0 * (here - self.over(times_min)) if is_zeroed else here


def _of_record(
    over: Callable[[FloatArray], FloatArray],
    white: float,
    times_min: FloatArray,
    *,
    is_zeroed: bool,
) -> FloatArray:
    """Make the covariance of a record from that over a time, of differences where zeroed."""
    result = over(np.abs(times_min[:, None] - times_min))
    result[np.diag_indices_from(result)] += white
    if is_zeroed:
        # cov(a − z, b − z) = cov(a, b) − cov(a, z) − cov(b, z) + var z; the noise of the zero is in
        # all rows.
        to_zero = over(np.abs(times_min))
        result += float(over(np.zeros(1))[0]) + white - to_zero[:, None] - to_zero
    return result
