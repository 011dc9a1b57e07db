"""What a model leaves of each set-up, as a user of the machine meets it: from the set-up's zero."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from app.arrays import FloatArray, IntArray, rms
from app.identification.residuals.residuals import Residuals
from app.search.rows import Rows
from app.search.zeros import UnknownZero, unknown_zeros, without_zeros


@dataclass(frozen=True, eq=False)
class SetUps:
    """All rows of a campaign by set-up.

    Parameters
    ----------
    values : ndarray, shape (n,)
        What is left of them [the channels' units].
    """

    residuals: Residuals
    values: FloatArray

    @cached_property
    def _rows(self) -> Rows:
        return self.residuals.as_rows()

    @cached_property
    def _zeros(self) -> list[UnknownZero]:
        return unknown_zeros(self._rows)

    @property
    def channel(self) -> IntArray:
        """Number of each row's channel, shape (n,)."""
        return self._rows.channel

    @cached_property
    def place(self) -> IntArray:
        """Number of each row's set-up, from 0 without gaps, shape (n,)."""
        _, places = np.unique(self._rows.visit, return_inverse=True)
        return places

    @property
    def count(self) -> int:
        """How many set-ups there are."""
        return int(self.place.max()) + 1

    @cached_property
    def remaining(self) -> FloatArray:
        """The values from where the instrument has its zero, shape (n,)."""
        return self.from_zero(self.values)

    @property
    def sizes(self) -> FloatArray:
        """What is left of each row's channel as a root mean square, 1 for nothing, shape (n,)."""
        sizes = np.ones(len(self.remaining))
        for number in np.unique(self.channel):
            here = self.channel == number
            sizes[here] = rms(self.remaining[here]) or 1.0
        return sizes

    def from_zero(self, values: FloatArray) -> FloatArray:
        """Count any values of the rows from there, shape (n,)."""
        return without_zeros(self._zeros, values)

    def sums(self, values: FloatArray) -> FloatArray:
        """Add values of all rows up by set-up, shape (V,)."""
        sums = np.bincount(self.place, weights=values, minlength=self.count)
        return sums.astype(np.float64)

    def without(self, rows: IntArray, change: FloatArray) -> SetUps:
        """Take something off in some rows.

        Parameters
        ----------
        rows, change : ndarray, shape (m,)
            Where, and how much.
        """
        values = self.values.copy()
        values[rows] -= change
        changed = SetUps(self.residuals, values)
        # What does not depend on the values is made once.
        for name in ("_rows", "_zeros", "place"):
            changed.__dict__[name] = getattr(self, name)
        return changed

    def label(self, place: int) -> str:
        """Name a set-up by its verification, and by itself where that states several."""
        rows = self.residuals.rows
        return rows.visit_label(int(rows.visit[np.argmax(self.place == place)]))
