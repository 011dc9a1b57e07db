"""Which visits learn and which are held out: folds in turn, and forward in time."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, IntArray
from app.search.rows import Rows

PARTS: Final = 3
"""Parts of a stretch: its edges, and what lies between."""

FIRST, MIDDLE, LAST = 0, 1, 2
EDGE: Final = 0.2
"""Share of a stretch that each edge is."""

ENOUGH_OF_EACH: Final = 2
"""So many visits for each fold are enough to hold whole ones out."""

LATE: Final = 0.3
"""Share of the blocks, the last ones, that a trend must foresee."""


class Splits(NamedTuple):
    """Cells of blocks that are held out, and teach, together.

    A fold is visits, or a stretch of a long one. What a stretch's neighbours hold near to it
    resembles it: they teach without their edges.

    Parameters
    ----------
    cell_of
        Block to cell.
    places : ndarray of int, shape (cells,)
        Where each cell lies, increasing: 2 (PARTS · fold + part of a stretch) + (0 early, 1 late).
        Places without blocks have no cell.
    folds
        How many; 0: nothing is held out.
    """

    cell_of: dict[int, int]
    places: IntArray
    folds: int

    @classmethod
    def of_places(cls, blocks: IntArray, places: IntArray, folds: int) -> Splits:
        """Gather blocks that lie in one place in a cell."""
        taken, cells = np.unique(places, return_inverse=True)
        return cls(dict(zip(blocks.tolist(), cells.tolist(), strict=True)), taken, folds)

    @property
    def cells(self) -> int:
        """How many cells there are."""
        return len(self.places)

    def fold(self, number: int) -> BoolArray:
        """Say which cells one fold holds out."""
        return np.asarray(self._folds() == number)

    def teaching(self, number: int) -> BoolArray:
        """Say which cells teach what is then asked of one fold."""
        part = self.places // 2 % PARTS
        before = (self._folds() == number - 1) & (part == LAST)
        after = (self._folds() == number + 1) & (part == FIRST)
        return np.asarray(~(self.fold(number) | before | after))

    def late(self) -> BoolArray:
        """Say which cells lie in the last part of the campaign."""
        return np.asarray(self.places % 2 == 1)

    def _folds(self) -> IntArray:
        return self.places // (2 * PARTS)


def split(rows: Rows, use: BoolArray, share: float) -> Splits:
    """Deal blocks to folds so that every fold has of each channel, from the whole campaign.

    Where there are enough visits, whole ones are held out: those that measure the same
    channels go to the folds in turn. Where components are measured one after the other, each
    has its own turn: else all visits of one could come into one fold, and nobody would be left
    to foresee them. Few but long visits are cut into stretches of time.

    Parameters
    ----------
    use : ndarray, shape (n,)
        Which rows take part.
    share
        Share that is held out each time: one fold for each 1/share, fewer where there are
        fewer blocks; none below two.

    Examples
    --------
    >>> of = lambda *v: Rows(np.zeros(len(v)), np.array(v), *np.zeros((1, len(v)), int),
    ...                      np.zeros((len(v), 0)), np.zeros(len(v), int), 1e3 * np.array(v))
    >>> split(of(1, 1, 2, 5, 7, 8), np.ones(6, bool), 0.5).cell_of
    {0: 0, 1: 2, 2: 0, 3: 3, 4: 1}
    """
    blocks, first = np.unique(rows.block[use], return_index=True)
    visits = rows.visit[use][first]
    folds = min(max(round(1.0 / share), 2), len(blocks))
    if len(blocks) < 2:
        return Splits.of_places(blocks, np.zeros(len(blocks), np.intp), 0)
    # Early and late ones are dealt together: one set of cells serves folds and forward test.
    first_late = len(blocks) - max(1, round(LATE * len(blocks)))
    is_late = np.arange(len(blocks)) >= first_late
    counted = np.unique(visits)
    if len(counted) >= min(ENOUGH_OF_EACH * folds, len(blocks)):
        folds = min(folds, len(counted))
        channels = [np.unique(rows.channel[use][rows.visit[use] == v]) for v in counted]
        dealt = np.array(_deal(channels, folds))[np.searchsorted(counted, visits)]
        place = PARTS * dealt + MIDDLE
    else:
        place = _stretches(rows, blocks, visits, folds)
        # A visit of few moments cannot be cut: without a second fold nothing is held out.
        folds = len(np.unique(place // PARTS))
        if folds < 2:
            return Splits.of_places(blocks, np.zeros(len(blocks), np.intp), 0)
    return Splits.of_places(blocks, 2 * place + is_late, folds)


def _stretches(rows: Rows, blocks: IntArray, visits: IntArray, folds: int) -> IntArray:
    """Cut every long visit into one stretch for each fold, of three parts; short ones in turn."""
    cells = np.zeros(len(blocks), dtype=np.intp)
    when = np.array([rows.minutes[rows.block == b].mean() for b in blocks])
    short = 0
    for visit in np.unique(visits):
        of_visit = np.flatnonzero(visits == visit)
        if len(of_visit) < 2 * folds:
            cells[of_visit] = PARTS * (short % folds) + MIDDLE
            short += 1
            continue
        # Equal in blocks, not in time: pauses teach nothing.
        order = np.argsort(when[of_visit], kind="stable")
        at = np.arange(len(of_visit)) * folds / len(of_visit)
        within = at % 1.0
        part = np.where(within < EDGE, FIRST, np.where(within >= 1.0 - EDGE, LAST, MIDDLE))
        cells[of_visit[order]] = PARTS * at.astype(np.intp) + part
    return cells


def _deal(channels: Sequence[IntArray], folds: int) -> list[int]:
    """Give each visit to the fold that has fewest of its channels, then fewest of all."""
    of_channel: dict[int, list[int]] = defaultdict(lambda: [0] * folds)
    in_all = [0] * folds
    dealt = []
    for channel in channels:
        counts = [of_channel[c] for c in channel.tolist()]
        fold = min(range(folds), key=lambda f: (sum(c[f] for c in counts), in_all[f], f))
        dealt.append(fold)
        in_all[fold] += 1
        for count in counts:
            count[fold] += 1
    return dealt
