"""Which visits learn and which are held out: folds in turn, and forward in time."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from app.identification.search.moments import BoolArray
from app.identification.search.rows import IntArray

LATE: Final = 0.3
"""Share of the visits, the last ones, that a trend must foresee."""


class Splits(NamedTuple):
    """Cells of visits: cell = 2 · fold + (0 early, 1 late)."""

    cell_of: dict[int, int]
    folds: int

    @property
    def cells(self) -> int:
        """How many cells there are."""
        return 2 * max(self.folds, 1)

    def fold(self, number: int) -> BoolArray:
        """Say which cells one fold holds out."""
        return np.asarray(np.arange(self.cells) // 2 == number)

    def late(self) -> BoolArray:
        """Say which cells lie in the last part of the campaign."""
        return np.asarray(np.arange(self.cells) % 2 == 1)


def split_visits(visit: IntArray, share: float) -> Splits:
    """Deal visits to folds in turn, so that every fold spans the whole campaign.

    Parameters
    ----------
    visit : ndarray, shape (n,)
        Numbers of the visits, growing with time.
    share
        Share of the visits that is held out each time.

    Returns
    -------
    Splits
        One fold for each 1/share; fewer where there are fewer visits; none below two.

    Examples
    --------
    >>> split_visits(np.array([1, 1, 2, 5, 7, 8]), 0.5).cell_of
    {1: 0, 2: 2, 5: 0, 7: 3, 8: 1}
    """
    visits = np.unique(visit)
    folds = min(max(round(1.0 / share), 2), len(visits))
    if len(visits) < 2:
        return Splits({int(v): 0 for v in visits}, 0)
    first_late = len(visits) - max(1, round(LATE * len(visits)))
    cells = {int(v): 2 * (i % folds) + int(i >= first_late) for i, v in enumerate(visits)}
    return Splits(cells, folds)
