"""What was asked, what was answered wrongly, and what went wrong on purpose: counted."""

from __future__ import annotations

import threading
import time
from collections import Counter

SHOWN = 20
"""Wrong answers that are kept in words; all are counted."""


class Tally:
    """Counts of one soak; many threads write into it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.checked: Counter[str] = Counter()
        self.faults: Counter[str] = Counter()
        self.statuses: Counter[int] = Counter()
        self.unanswered = 0
        self.wrong = 0
        self.words: list[str] = []

    def check(self, kind: str, what: str, differences: list[str]) -> None:
        """Count an answer that was held against what it must be."""
        with self._lock:
            self.checked[kind] += 1
        if differences:
            self.find(f"{kind}, {what}: " + "; ".join(differences))

    def find(self, words: str) -> None:
        """Count something that must not be."""
        with self._lock:
            self.wrong += 1
            if len(self.words) < SHOWN:
                at = time.strftime("%H:%M:%S", time.gmtime())
                self.words.append(f"{at} {words[:600]}")

    def answer(self, status: int) -> None:
        """Count an answer, or with 0 that there was none."""
        with self._lock:
            if status:
                self.statuses[status] += 1
            else:
                self.unanswered += 1

    def fault(self, name: str, times: int = 1) -> None:
        """Count a fault that was made on purpose."""
        with self._lock:
            self.faults[name] += times
