"""Which numbers of readings may still appear: a database gives them before it commits."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Iterable, Sequence
from datetime import datetime, timedelta
from threading import Lock

PATIENCE = timedelta(seconds=60)
"""A number that has been left out for longer belongs to a transaction that failed."""

MOST_GAPS = 200
"""Gaps that are kept: the newest."""

MOST_STORED_HERE = 200_000
"""Numbers that are kept until somebody asks: the newest; the others are read once more."""


class UnseenNumbers:
    """The numbers above the highest that was seen, and for a while those left out below it.

    A transaction gets its numbers at its beginning and shows them at its end. So a lower
    number may appear after a higher one; or never, if the transaction was rolled back.
    """

    def __init__(self, highest: int) -> None:
        self.highest = highest
        self._gaps: list[tuple[int, int, datetime]] = []

    @property
    def gaps(self) -> list[tuple[int, int]]:
        """First and last number of each gap below the highest."""
        return [(first, last) for first, last, _ in self._gaps]

    def mark_seen(self, numbers: Iterable[int], now: datetime) -> None:
        """Take note of all the unseen numbers that there are now.

        >>> from datetime import UTC
        >>> unseen = UnseenNumbers(highest=3)
        >>> unseen.mark_seen([4, 6, 9], datetime(2026, 3, 1, tzinfo=UTC))
        >>> unseen.highest, unseen.gaps
        (9, [(5, 5), (7, 8)])
        """
        came = sorted(numbers)
        gaps = [
            (*gap, since)
            for first, last, since in self._gaps
            if now - since < PATIENCE
            for gap in _left_out(first, last, came)
        ]
        if came and came[-1] > self.highest:
            gaps += [(*gap, now) for gap in _left_out(self.highest + 1, came[-1], came)]
            self.highest = came[-1]
        self._gaps = gaps[-MOST_GAPS:]

    def mark_known(self, numbers: Sequence[int], now: datetime) -> None:
        """Take note of numbers that need not be asked for, though others below may be there.

        Those between which others have too many of theirs are asked for nevertheless: a gap that
        is not kept would be missed.
        """
        marked = UnseenNumbers(self.highest)
        marked._gaps = self._gaps
        marked.mark_seen(numbers, now)
        if len(marked._gaps) < MOST_GAPS // 2:
            self.highest, self._gaps = marked.highest, marked._gaps


class StoredHere:
    """Numbers of readings that this process stored and holds: it need not read them again."""

    def __init__(self) -> None:
        self._numbers: deque[int] = deque(maxlen=MOST_STORED_HERE)
        self._lock = Lock()

    def note(self, numbers: Iterable[int]) -> None:
        """Note what was committed and is in memory."""
        with self._lock:
            self._numbers.extend(numbers)

    def take(self) -> list[int]:
        """Give what was noted since the last time; what was too much is left out."""
        with self._lock:
            taken = list(self._numbers)
            self._numbers.clear()
        return taken


def _left_out(first: int, last: int, came: Sequence[int]) -> list[tuple[int, int]]:
    """Find what is left of a range of numbers without those that came, in order."""
    gaps = []
    for number in came[bisect_left(came, first) : bisect_right(came, last)]:
        if number > first:
            gaps.append((first, number - 1))
        first = number + 1
    return [*gaps, (first, last)] if first <= last else gaps
