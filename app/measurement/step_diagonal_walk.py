"""Where a machine stands at each reading of a sequential step diagonal, and what moved then."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from app.arrays import FloatArray
from app.geometry.components import LINEAR_LETTERS


@dataclass(frozen=True, eq=False)
class StepWalk:
    """The steps of all measured diagonals (C. Wang 2000, III E and III I).

    Parameters
    ----------
    origin_mm, step_mm : ndarray, shape (3,) [mm]
        Lowest corner of the volume, and the positive steps X, Y, Z.
    steps
        Number n of steps of each axis.
    diagonals
        Names of the m measured diagonals, `ppp` …
    """

    origin_mm: FloatArray
    step_mm: FloatArray
    steps: int
    diagonals: tuple[str, ...]

    @cached_property
    def ways(self) -> FloatArray:
        """+1 where an axis runs up and −1 where it runs down: shape (m, 3)."""
        return np.array([[1.0 if way == "p" else -1.0 for way in d] for d in self.diagonals])

    @cached_property
    def rays(self) -> FloatArray:
        """Unit vector r of each diagonal: shape (m, 3)."""
        rays: FloatArray = self.ways * self.step_mm / np.linalg.norm(self.step_mm)
        return rays

    @property
    def centre_mm(self) -> FloatArray:
        """Middle of the volume, where all diagonals cross: shape (3,) [mm]."""
        centre: FloatArray = self.origin_mm + self.step_mm * self.steps / 2
        return centre

    def nodes_mm(self, axis: str) -> FloatArray:
        """Give the n + 1 positions at which an axis stands.

        Parameters
        ----------
        axis
            `x`, `y` or `z`.

        Returns
        -------
        ndarray, shape (n + 1,) [mm]
            Increasing.
        """
        i = LINEAR_LETTERS.index(axis)
        nodes: FloatArray = self.origin_mm[i] + self.step_mm[i] * np.arange(self.steps + 1)
        return nodes

    def positions_mm(self) -> FloatArray:
        """Give where the machine stands at the start and at each reading.

        Returns
        -------
        ndarray, shape (m, 3n + 1, 3) [mm]
        """
        # At reading j axis x (0) has made (j + 2) // 3 steps, y (1) (j + 1) // 3, z (2) j // 3.
        made = (np.arange(3 * self.steps + 1)[:, None] + [2, 1, 0]) // 3
        nodes = np.where(self.ways[:, None] > 0, made, self.steps - made)
        return self.origin_mm + nodes * self.step_mm

    def by_interval(self, readings_um: FloatArray) -> FloatArray:
        """Sort what each single step added by the axis and the interval that it crossed.

        Parameters
        ----------
        readings_um : ndarray, shape (m, n, 3) [µm]
            Cumulative readings after x, y and z of each step.

        Returns
        -------
        ndarray, shape (m, 3, n) [µm]
            For diagonal, axis and interval, r · (E(upper end) − E(lower end)): a traverse
            downwards has its sign reversed, as in [V 6].
        """
        flat = readings_um.reshape(len(self.diagonals), -1)
        added = np.diff(flat, axis=1, prepend=0.0).reshape(readings_um.shape)
        return self.turned(added.transpose(0, 2, 1))

    def turned(self, along: FloatArray) -> FloatArray:
        """Exchange the order of steps for that of intervals, or back: the same for both.

        Parameters
        ----------
        along : ndarray, shape (m, 3, n)
            Quantities that change their sign with the way, for diagonal, axis and step.

        Returns
        -------
        ndarray, shape (m, 3, n)
        """
        up = self.ways[:, :, None] > 0
        return np.where(up, along, -along[:, :, ::-1])

    def reading_weights(self, weights: FloatArray) -> FloatArray:
        """Turn weights on the intervals' increments into weights on the readings.

        Parameters
        ----------
        weights : ndarray, shape (m, 3, n)
            Of what `by_interval` gives.

        Returns
        -------
        ndarray, shape (m, 3n + 1)
            Of the m diagonals' readings, the zero at the start first.
        """
        steps = self.turned(weights).transpose(0, 2, 1).reshape(len(self.diagonals), -1)
        ends = np.pad(steps, ((0, 0), (1, 1)))
        found: FloatArray = ends[:, :-1] - ends[:, 1:]
        return found
