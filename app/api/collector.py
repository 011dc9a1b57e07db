"""Times without Python's collector of cycles, which would hold up everybody.

What long bodies say, and what is made of it, are millions of objects without cycles. The
collector would go through them again and again, for half a second at a time, in which nobody
has a turn, the live table neither.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from time import monotonic
from typing import Final

LONGEST_S: Final = 60.0
"""Without the collector at a stretch [s]: what others leave behind meanwhile adds up."""


class _Uncollected:
    """How many want no collector now, and since when there has been none."""

    def __init__(self) -> None:
        self.lock = Lock()
        self.count = 0
        self.since_s = 0.0


_now = _Uncollected()


@contextmanager
def uncollected() -> Iterator[None]:
    """Do without the collector; where others have long done without it already, with it."""
    with _now.lock:
        if not _now.count:
            _now.since_s = monotonic()
            gc.disable()
        elif monotonic() - _now.since_s > LONGEST_S:
            gc.enable()
        _now.count += 1
    try:
        yield
    finally:
        with _now.lock:
            _now.count -= 1
            if not _now.count:
                gc.enable()
