"""Let one of several threads do at once what they all want."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from threading import Event, Lock, Semaphore
from typing import Final, Generic, TypeVar

from app.errors import StorageBusy, StorageUnavailable

log = logging.getLogger("thermap")

Work = TypeVar("Work")

MOST_TOGETHER: Final = 50
"""Pieces of work that one thread does: nobody waits for a transaction without end."""


@dataclass(eq=False, slots=True)
class Wanted(Generic[Work]):
    """A piece of work; `end` is called, in whatever thread, once nothing more becomes of it.

    `error` is what kept it from being done, if the database was away.
    """

    work: Work
    end: Callable[[], None]
    error: StorageUnavailable | None = field(default=None, init=False)

    def expect_database(self) -> None:
        """Raise StorageUnavailable if the database was away."""
        if self.error is not None:
            # One of its own: several may have been kept from being done by the same.
            raise type(self.error)(self.error.detail) from self.error


class Together(Generic[Work]):
    """Gathers what is wanted while something is being done, and has it done together next.

    Nobody waits for others to come: what comes alone is done at once, by the thread that wants it
    or, for who cannot wait, by one of its own.

    Parameters
    ----------
    at_once
        How many threads do something at the same time.
    """

    def __init__(self, at_once: int = 1) -> None:
        self._turn = Semaphore(at_once)
        self._waiting: list[Wanted[Work]] = []
        self._guard = Lock()
        self._threads = ThreadPoolExecutor(at_once, "together")  # none before one is needed

    @property
    def has_room(self) -> bool:
        """Whether what comes now is among those that are done next."""
        return len(self._waiting) < MOST_TOGETHER

    def begin(
        self,
        wanted: Wanted[Work],
        do: Callable[[Sequence[Work]], None],
        after: Callable[[Sequence[Work]], None],
    ) -> None:
        """Have a piece of work done as `run` does, by another thread; who asks waits for nothing.

        What goes wrong otherwise than because the database is away stands in the log.
        """
        with self._guard:
            self._waiting.append(wanted)
        self._threads.submit(self._begun, wanted, do, after)

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
        is_done = Event()
        wanted = Wanted(work, is_done.set)
        with self._guard:
            self._waiting.append(wanted)
        self._work_off(wanted, do, after)
        is_done.wait()
        wanted.expect_database()

    def _begun(
        self,
        wanted: Wanted[Work],
        do: Callable[[Sequence[Work]], None],
        after: Callable[[Sequence[Work]], None],
    ) -> None:
        try:
            self._work_off(wanted, do, after)
        except Exception:
            log.exception("what was to be done together failed")

    def _work_off(
        self,
        wanted: Wanted[Work],
        do: Callable[[Sequence[Work]], None],
        after: Callable[[Sequence[Work]], None],
    ) -> None:
        """Do what has waited longest, until a thread has taken this one."""
        #   append ──> wait for a turn ──> take the first of those that wait ──> do ──> after
        #
        # Whoever waits for the turn mostly finds its own piece taken: the thread before has done it
        # along with its own. Where more wait than one takes, the piece may not be among the first:
        # so it goes on until somebody has it. `after` is outside of the turn, for the next ones are
        # being done meanwhile.
        while self._waits(wanted):
            group: list[Wanted[Work]] = []
            try:
                with self._turn:
                    group += self._take(wanted)
                    is_done = self._do(group, do)
                if is_done:
                    after([one.work for one in group])
            finally:
                for wanted_work in group:
                    wanted_work.end()

    def _waits(self, wanted: Wanted[Work]) -> bool:
        with self._guard:
            return wanted in self._waiting

    def _take(self, wanted: Wanted[Work]) -> list[Wanted[Work]]:
        """Take those that have waited longest; none when another thread has taken this one."""
        with self._guard:
            if wanted not in self._waiting:
                return []
            group, self._waiting = self._waiting[:MOST_TOGETHER], self._waiting[MOST_TOGETHER:]
        return group

    def _do(self, group: list[Wanted[Work]], do: Callable[[Sequence[Work]], None]) -> bool:
        """Do some; where the database is away, send away who waits for it as well."""
        if not group:
            return False
        try:
            do([one.work for one in group])
        except StorageUnavailable as error:
            # A database that is away for one is away for all: each of them would wait out the same
            # limit, one behind the other. Of one that is busy the next may find its rows free.
            if not isinstance(error, StorageBusy):
                with self._guard:
                    group += self._waiting
                    self._waiting = []
            for wanted_work in group:
                wanted_work.error = error
            return False
        return True
