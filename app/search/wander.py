"""How an instrument and a machine wander within one set-up: a covariance in time.

White noise, a wander that forgets exponentially (Ornstein-Uhlenbeck) and a smooth one (Matérn
3/2) add up. Where a set-up was zeroed at its first observation, what is left is their difference
from that observation, the noise of the zero included. A set-up that is zeroed before the machine
is switched on may also jump as it begins, all that follows with it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray

ROOT_3: Final = float(np.sqrt(3.0))

JUMP_MIN: Final = 4.0
"""Time constant of the jump [min]: some minutes, as the first layers of a body that is suddenly
heated take; not fitted, because rows are hardly closer together than that."""


class Wander(NamedTuple):
    """White noise, two wanders, and a jump as a zeroed set-up begins.

    Parameters
    ----------
    white
        Standard deviation of one observation [the values' unit].
    rough, rough_min
        Standard deviation and time constant [min] of the wander that forgets exponentially.
    smooth, smooth_min
        The same of the smooth one.
    jump
        Standard deviation of the jump; 0: there is none.
    """

    white: float
    rough: float
    rough_min: float
    smooth: float
    smooth_min: float
    jump: float = 0.0

    def larger(self, by: float) -> Wander:
        """Multiply all variances by a number."""
        root = float(np.sqrt(by))
        return self._replace(
            white=root * self.white,
            rough=root * self.rough,
            smooth=root * self.smooth,
            jump=root * self.jump,
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
        found = _of_set_up(self.over, self.white**2, times_min, is_zeroed)
        return found + self.jump**2 * _jumps(times_min, is_zeroed) if self.jump else found

    def slopes(self, times_min: FloatArray, is_zeroed: BoolArray) -> list[FloatArray]:
        """Give the slopes of `covariance` in the logarithms of its parameters; no jump has none."""

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
        found = [_of_set_up(over, white, times_min, is_zeroed) for over, white in parts]
        if self.jump:
            found.append(2.0 * self.jump**2 * _jumps(times_min, is_zeroed))
        return found

    def variance(self, times_min: FloatArray, *, is_zeroed: bool) -> FloatArray:
        """Give what wander and jump make uncertain at n times, shape (n,), without the noise."""
        here: FloatArray = np.broadcast_to(self.over(np.zeros(1)), times_min.shape)
        if not is_zeroed:
            return here
        return 2.0 * (here - self.over(times_min)) + (self.jump * jumped(times_min)) ** 2


def jumped(times_min: FloatArray) -> FloatArray:
    """Say which share of its jump a set-up has made at n times since its zero [min], shape (n,).

    Examples
    --------
    >>> jumped(np.array([0.0, 4.0, 60.0])).round(2).tolist()
    [0.0, 0.63, 1.0]
    """
    found: FloatArray = 1.0 - np.exp(-times_min / JUMP_MIN)
    return found


def _jumps(times_min: FloatArray, is_zeroed: BoolArray) -> FloatArray:
    """Give the covariance of a jump of 1, shape (m, n, n)."""
    share = np.where(is_zeroed[:, None], jumped(times_min), 0.0)
    found: FloatArray = share[:, :, None] * share[:, None, :]
    return found


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
