"""Which visits learn and which are held out: folds in turn, and forward in time."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, IntArray

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


def split_visits(visit: IntArray, channel: IntArray, share: float) -> Splits:
    """Deal visits to folds so that every fold has of each channel, from the whole campaign.

    Visits that measure the same channels go to the folds in turn. Where components are
    measured one after the other, each has its own turn: else all visits of one could come
    into one fold, and nobody would be left to foresee them.

    Parameters
    ----------
    visit : ndarray, shape (n,)
        Numbers of the visits, growing with time.
    channel : ndarray, shape (n,)
        What each row is of.
    share
        Share of the visits that is held out each time.

    Returns
    -------
    Splits
        One fold for each 1/share; fewer where there are fewer visits; none below two.

    Examples
    --------
    >>> same = np.zeros(6, dtype=int)
    >>> split_visits(np.array([1, 1, 2, 5, 7, 8]), same, 0.5).cell_of
    {1: 0, 2: 2, 5: 0, 7: 3, 8: 1}
    >>> in_turn = np.array([0, 1, 0, 1])
    >>> split_visits(np.array([1, 2, 3, 4]), in_turn, 0.5).cell_of
    {1: 0, 2: 2, 3: 2, 4: 1}
    """
    visits = np.unique(visit)
    folds = min(max(round(1.0 / share), 2), len(visits))
    if len(visits) < 2:
        return Splits({int(v): 0 for v in visits}, 0)
    first_late = len(visits) - max(1, round(LATE * len(visits)))
    dealt = _deal([np.unique(channel[visit == v]) for v in visits], folds)
    cells = {
        int(v): 2 * fold + int(i >= first_late)
        for i, (v, fold) in enumerate(zip(visits, dealt, strict=True))
    }
    return Splits(cells, folds)


def _deal(channels: Sequence[IntArray], folds: int) -> list[int]:
    """Give each visit to the fold that has fewest of its channels, then fewest of all."""
    of_channel: dict[int, list[int]] = defaultdict(lambda: [0] * folds)
    in_all = [0] * folds
    dealt = []
    for own in channels:
        counts = [of_channel[c] for c in own.tolist()]
        fold = min(range(folds), key=lambda f: (sum(c[f] for c in counts), in_all[f], f))
        dealt.append(fold)
        in_all[fold] += 1
        for count in counts:
            count[fold] += 1
    return dealt
