"""Run queued analyses, one at a time, each in a process of its own.

Several services may share a database: each takes what nobody else has taken. A job that
runs beats in the database; where it no longer does, its service is gone, and another one
says so.
"""

from __future__ import annotations

import logging
import multiprocessing
import signal
from multiprocessing.connection import Connection
from threading import Event, Lock, Thread
from time import monotonic
from typing import Any, Final
from uuid import uuid4

from app.errors import StorageUnavailable
from app.services.analysis_process import JobUpdate, run_analysis
from app.services.context import Context
from app.services.events import note_analysis
from app.storage.analyses import (
    claim_analysis,
    fail_analysis,
    finish_analysis,
    has_queued,
    machine_of_analysis,
    record_heartbeat,
    running_analyses,
)

log = logging.getLogger("thermap")

HEARTBEAT_S: Final = 1.0
"""How often a running job says that it is alive [s]."""

PATIENCE_S: Final = 15.0
"""A job that has not beaten for so long was run by a service that is gone [s]."""

QUEUE_POLL_S: Final = 2.0
"""How often the queue is looked at for what other services put there [s]."""

CANCEL_POLL_S: Final = 0.1
"""How soon a cancelled process is ended [s]."""

STOPPED: Final = "the service stopped while it ran"

_SPAWN: Final = multiprocessing.get_context("spawn")


class AnalysisRunner:
    """Takes analyses off the queue, follows their processes and stores what they find.

    It has a thread of its own, begun by `start` or by the first `wake`.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self._owner = str(uuid4())
        self._stop = Event()
        self._wakened = Event()
        self._starting = Lock()
        self._thread: Thread | None = None
        self._others: dict[int, tuple[tuple[str, int], float]] = {}

    def start(self) -> None:
        """Begin, unless it has begun."""
        with self._starting:
            if self._thread is None and not self._stop.is_set():
                self._thread = Thread(target=self._run, name="analyses", daemon=True)
                self._thread.start()

    def wake(self) -> None:
        """Look at the queue, or at whether the running job was cancelled, now."""
        self.start()
        self._wakened.set()

    def stop(self, patience_s: float = 10.0) -> None:
        """End: the running job fails with the reason, the others wait for another service.

        Where the database hangs, the reason is not stored: another service finds out.
        """
        self._stop.set()
        self._wakened.set()
        if self._thread is not None:
            self._thread.join(patience_s)

    def _run(self) -> None:
        while not self._stop.is_set():
            self._wakened.clear()
            try:
                self._fail_abandoned()
                while not self._stop.is_set() and self._run_next():
                    pass
            except StorageUnavailable:
                self._others.clear()  # who could not write gave no heartbeat that was seen
            except Exception:
                log.exception("could not look at the queue of analyses")
            self._wakened.wait(QUEUE_POLL_S)

    def _run_next(self) -> bool:
        """Run the first job of the queue; False where it is empty."""
        database = self._context.database
        with database.reading() as session:
            if not has_queued(session):
                return False
        with database.writing() as session:
            analysis_id = claim_analysis(session, self._owner, self._context.now())
        if analysis_id is None:
            return False
        log.info("analysis %d begins", analysis_id)
        try:
            update = self._run_job(analysis_id)
        except Exception as error:
            log.exception("analysis %d could not be followed", analysis_id)
            update = JobUpdate("failed", f"unexpected error: {type(error).__name__}: {error}")
        if update is not None:
            self._store(analysis_id, update)
        return True

    def _run_job(self, analysis_id: int) -> JobUpdate | None:
        """Run a job to its last update, and leave nothing of it behind."""
        url = self._context.database.engine.url.render_as_string(hide_password=False)
        job = _Job(url, analysis_id)
        try:
            job.start()
            return self._followed(job, analysis_id)
        finally:
            job.end()

    def _followed(self, job: _Job, analysis_id: int) -> JobUpdate | None:
        """Wait for a job's last update; None where nobody waits for them any more."""
        progress = JobUpdate("progress", "reading")
        beaten_at = monotonic()
        while not self._stop.is_set():
            update = job.listen(CANCEL_POLL_S)
            if update is not None and update.kind != "progress":
                return update
            progress = update or progress
            if monotonic() - beaten_at >= HEARTBEAT_S or self._wakened.is_set():
                self._wakened.clear()
                beaten_at = monotonic()
                if not self._record_heartbeat(analysis_id, progress):
                    return None
        return JobUpdate("failed", STOPPED)

    def _record_heartbeat(self, analysis_id: int, progress: JobUpdate) -> bool:
        """Write that a job is alive; False where it was cancelled, deleted or given up."""
        try:
            with self._context.database.writing() as session:
                alive = record_heartbeat(
                    session, analysis_id, self._owner, progress.progress, progress.text
                )
            self._fail_abandoned()
        except StorageUnavailable:
            self._others.clear()
            return True  # it goes on; its result waits for the database
        return alive

    def _store(self, analysis_id: int, update: JobUpdate) -> None:
        """Store a result or a reason; where the database is away, as soon as it is back."""
        while True:
            now = self._context.now()
            try:
                with self._context.database.writing() as session:
                    if update.kind == "done":
                        ended = finish_analysis(session, analysis_id, self._owner, update.text, now)
                    else:
                        ended = fail_analysis(
                            session, analysis_id, self._owner, None, update.text, now
                        )
                    if ended:
                        words = "done" if update.kind == "done" else f"failed: {update.text}"
                        machine_id = machine_of_analysis(session, analysis_id)
                        note_analysis(session, machine_id, analysis_id, words, now)
                log.info("analysis %d %s", analysis_id, update.kind)
                return
            except StorageUnavailable as error:
                log.warning("analysis %d waits to be stored: %s", analysis_id, error.detail)
                if self._stop.wait(HEARTBEAT_S):
                    return

    def _fail_abandoned(self) -> None:
        """Fail what other services ran and no longer run."""
        with self._context.database.reading() as session:
            running = running_analyses(session)
        now_s = monotonic()
        others = {i: beats for i, beats in running.items() if beats[0] != self._owner}
        seen = {i: self._others.get(i, (beats, now_s)) for i, beats in others.items()}
        self._others = {
            i: known if known[0] == others[i] else (others[i], now_s) for i, known in seen.items()
        }
        for i, ((owner, beats), since_s) in self._others.items():
            if now_s - since_s >= PATIENCE_S:
                now = self._context.now()
                with self._context.database.writing() as session:
                    if fail_analysis(session, i, owner, beats, STOPPED, now):
                        machine_id = machine_of_analysis(session, i)
                        note_analysis(session, machine_id, i, f"failed: {STOPPED}", now)


class _Job:
    """A process that analyses, and what it tells."""

    def __init__(self, database_url: str, analysis_id: int) -> None:
        self._from_process, self._to_service = _SPAWN.Pipe(duplex=False)
        self._process = _SPAWN.Process(
            target=run_analysis,
            args=(database_url, analysis_id, self._to_service),
            name=f"analysis {analysis_id}",
            daemon=True,
        )

    def start(self) -> None:
        self._process.start()
        # Its other end is the process' alone: when that is gone, so is the pipe.
        self._to_service.close()

    def listen(self, patience_s: float) -> JobUpdate | None:
        """Give the process' next update; that it ended without any is `failed`."""
        listening: Connection[Any, Any] = self._from_process
        try:
            if listening.poll(patience_s):
                update: JobUpdate = listening.recv()
                return update
        except (EOFError, OSError):
            self._process.join(5.0)
            return JobUpdate(
                "failed", f"its process ended unexpectedly ({_words(self._process.exitcode)})"
            )
        return None

    def end(self) -> None:
        """End the process, whatever it does, and give up what it held."""
        if self._process.pid is not None:
            self._process.kill()
            self._process.join()
            self._process.close()
        self._from_process.close()
        self._to_service.close()


def _words(exit_code: int | None) -> str:
    """Say how a process ended.

    >>> _words(-9), _words(1)
    ('killed by SIGKILL', 'exit code 1')
    """
    if exit_code is not None and exit_code < 0:
        return f"killed by {signal.Signals(-exit_code).name}"
    return f"exit code {exit_code}"
