"""Let one of several threads do at once what they all want."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from threading import Event, Lock, Semaphore
from typing import Final, Generic, TypeVar

from app.errors import StorageBusy, StorageUnavailable

Work = TypeVar("Work")

MOST_TOGETHER: Final = 50
"""Pieces of work that one thread does: nobody waits for a transaction without end."""


@dataclass(eq=False, slots=True)
class _Wanted(Generic[Work]):
    work: Work
    is_done: Event = field(default_factory=Event)
    error: StorageUnavailable | None = None


class Together(Generic[Work]):
    """Gathers what is wanted while something is being done, and has it done together next.

    Nobody waits for others to come: what comes alone is done at once.

    Parameters
    ----------
    at_once
        How many threads do something at the same time.
    """

    def __init__(self, at_once: int = 1) -> None:
        self._turn = Semaphore(at_once)
        self._waiting: list[_Wanted[Work]] = []
        self._guard = Lock()

    def run(
        self,
        work: Work,
        do: Callable[[Sequence[Work]], None],
        after: Callable[[Sequence[Work]], None],
    ) -> None:
        """Have a piece of work done, and wait for its end.

        Parameters
        ----------
        do
            Does several pieces, all or none. What fails otherwise than
            because the database is away leaves nothing done.
        after
            What is then left to do, while the next ones are being done.

        Raises
        ------
        StorageUnavailable
            If the database was away, for those that were done and those that waited.
        """
        wanted = _Wanted(work)
        with self._guard:
            self._waiting.append(wanted)
        while not wanted.is_done.is_set():
            with self._turn:
                group = self._take(wanted)
                is_done = self._do(group, do)
            try:
                if is_done:
                    after([one.work for one in group])
            finally:
                for one in group:
                    one.is_done.set()
            if not group:
                wanted.is_done.wait()
        if wanted.error is not None:
            raise type(wanted.error)(wanted.error.detail) from wanted.error

    def _take(self, wanted: _Wanted[Work]) -> list[_Wanted[Work]]:
        """Take those that have waited longest; none when another thread has taken this one."""
        with self._guard:
            if wanted not in self._waiting:
                return []
            group, self._waiting = self._waiting[:MOST_TOGETHER], self._waiting[MOST_TOGETHER:]
        return group

    def _do(self, group: list[_Wanted[Work]], do: Callable[[Sequence[Work]], None]) -> bool:
        """Do some; where the database is away, send away who waits for it as well."""
        if not group:
            return False
        try:
            do([one.work for one in group])
        except StorageUnavailable as error:
            if not isinstance(error, StorageBusy):
                with self._guard:
                    group += self._waiting
                    self._waiting = []
            for one in group:
                one.error = error
            return False
        return True
