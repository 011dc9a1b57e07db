"""Who runs the analyses that wait: this process by itself, or workers that Procrastinate asks.

On SQLite a process looks at the table of analyses; on PostgreSQL Procrastinate hands them out, to
the services and to `thermap worker` on any host. The table says in both cases what became of each.
"""

from __future__ import annotations

import logging
from threading import Event, Lock, Thread
from time import monotonic
from typing import Protocol

from app.errors import StorageUnavailable
from app.services.carry_analyses import (
    QUEUE_POLL_S,
    STOP_S,
    AbandonedAnalyses,
    AnalysisCarrier,
    Carried,
    Looked,
)
from app.services.context import Context
from app.storage.analyses import next_analysis

log = logging.getLogger("thermap")


def _to_nobody(_answered: bool) -> None:
    pass


class AnalysisRunner(Protocol):
    """What runs analyses in threads of this process."""

    def start(self) -> None:
        """Begin, unless it has begun."""

    def wake(self) -> None:
        """Look now at what waits, and at whether a running job was cancelled."""

    def stop(self, patience_s: float = STOP_S, *, finish_s: float = 0.0) -> None:
        """End: what runs is finished within `finish_s` [s], or given back to the queue.

        Where the database hangs for `patience_s` [s] it is not given back: others find out.
        """


def make_runner(
    context: Context,
    *,
    runs_here: bool = True,
    concurrency: int = 1,
    looked: Looked = _to_nobody,
) -> AnalysisRunner:
    """Make what runs a database's analyses.

    Parameters
    ----------
    runs_here
        Whether this process runs any.
    looked
        Called after every look at the queue, every `QUEUE_POLL_S` or so.
    """
    if not runs_here:
        return NoAnalyses()
    if context.database.is_sqlite:
        return EmbeddedRunner(context, concurrency, looked)
    from app.services.handed_analyses import HandedAnalyses

    return HandedAnalyses(context, concurrency, looked)


class NoAnalyses:
    """Leaves all analyses to others."""

    def start(self) -> None:
        """Do nothing."""

    def wake(self) -> None:
        """Do nothing: others look by themselves."""

    def stop(self, patience_s: float = STOP_S, *, finish_s: float = 0.0) -> None:
        """Do nothing."""


class EmbeddedRunner:
    """Takes analyses off the table by itself, in threads begun by `start` or the first `wake`."""

    def __init__(self, context: Context, concurrency: int = 1, looked: Looked = _to_nobody) -> None:
        self._context = context
        self._looked = looked
        self._carrier = AnalysisCarrier(context)
        self._abandoned = AbandonedAnalyses(context)
        self._concurrency = concurrency
        self._ends = Event()
        self._wakened = [Event() for _ in range(concurrency)]
        self._starting = Lock()
        self._threads: list[Thread] = []

    def start(self) -> None:
        """Begin, unless it has begun."""
        with self._starting:
            if self._threads or self._ends.is_set():
                return
            self._threads = [
                *(Thread(target=self._run, args=(wakened,)) for wakened in self._wakened),
                Thread(target=self._watch),
            ]
            for thread in self._threads:
                thread.name, thread.daemon = "analyses", True
                thread.start()

    def wake(self) -> None:
        """Look now at what waits, and at whether a running job was cancelled."""
        self.start()
        self._carrier.look()
        for wakened in self._wakened:
            wakened.set()

    def stop(self, patience_s: float = STOP_S, *, finish_s: float = 0.0) -> None:
        """End: what runs is finished within `finish_s` [s], or given back to the queue."""
        self._ends.set()
        self._join(finish_s)
        self._carrier.stop()
        self._join(patience_s)

    def _join(self, patience_s: float) -> None:
        for wakened in self._wakened:
            wakened.set()
        until_s = monotonic() + patience_s
        for thread in self._threads:
            thread.join(max(0.0, until_s - monotonic()))

    def _run(self, wakened: Event) -> None:
        while not self._ends.is_set():
            # Before it is looked: who wakes it from now on is heard by the wait below.
            wakened.clear()
            try:
                while not self._ends.is_set() and self._run_next():
                    pass
            except StorageUnavailable:
                pass  # said where it is waited for; it is looked at again
            except Exception:
                log.exception("could not look at the queue of analyses")
            wakened.wait(QUEUE_POLL_S)

    def _run_next(self) -> bool:
        """Run the first job of the queue; False where there is none to run."""
        with self._context.database.reading() as session:
            number = next_analysis(session)
        return number is not None and self._carrier.carry_out(number) is Carried.OVER

    def _watch(self) -> None:
        """Find what others ran and no longer run."""
        while not self._ends.wait(QUEUE_POLL_S):
            try:
                self._abandoned.look()
                self._looked(True)
            except StorageUnavailable:
                self._looked(False)
            except Exception:
                log.exception("could not look for abandoned analyses")
