"""Carry an analysis out: begin it, follow its process, store what it finds.

Whoever hands analyses out, a try is one and the same: it has a name of its own, by which it
beats in the database. What is taken up by others, cancelled or deleted meanwhile is theirs: the
process is ended and nothing is stored.
"""

from __future__ import annotations

import logging
import multiprocessing
import signal
from collections.abc import Callable
from enum import Enum
from multiprocessing.connection import Connection
from threading import Event
from time import monotonic
from typing import Any, Final, TypeAlias
from uuid import uuid4

from sqlalchemy.exc import IntegrityError

from app.errors import StorageUnavailable
from app.services.analysis_process import JobUpdate, run_analysis
from app.services.context import Context
from app.services.events import note_analysis
from app.storage.analyses import (
    begin_analysis,
    fail_analysis,
    finish_analysis,
    give_back,
    give_up,
    machine_of_analysis,
    record_heartbeat,
    running_analyses,
)
from app.storage.records import AnalysisStatus

log = logging.getLogger("thermap")

HEARTBEAT_S: Final = 1.0
"""How often a running job says that it is alive [s]."""

PATIENCE_S: Final = 15.0
"""A job that has not beaten for so long was run by a process that is gone [s]."""

CANCEL_POLL_S: Final = 0.1
"""How soon a cancelled process is ended [s]."""

QUEUE_POLL_S: Final = 2.0
"""How often the queue is looked at for what other processes put there [s]."""

STOP_S: Final = 10.0
"""How long the end may take where the database hangs [s]."""

Looked: TypeAlias = Callable[[bool], None]
"""Called after each look at the queue: whether the database answered."""

# Not by fork: the copy would have the locks of threads that it lacks, and the connections to the
# database of this process.
_SPAWN: Final = multiprocessing.get_context("spawn")


class Carried(Enum):
    """What became of an analysis that was to be carried out."""

    OVER = "it has its result or its reason, or is somebody else's"
    BUSY = "another one of its machine runs"
    BACK = "it waits again, for this process ends"


class AnalysisCarrier:
    """Carries analyses out, each in a process of its own; several threads may ask at once."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._stop = Event()
        # Counted rather than a flag: each thread that follows a job has to see it, and none may
        # take it away from the others.
        self._looks = 0

    def look(self) -> None:
        """Look now at whether a running job was cancelled."""
        self._looks += 1

    def stop(self) -> None:
        """Give the running jobs back to the queue, and begin no others."""
        self._stop.set()

    def carry_out(self, analysis_id: int) -> Carried:
        """Run an analysis that waits, to its end.

        Raises
        ------
        StorageUnavailable
            If it could not be begun.
        """
        if self._stop.is_set():
            return Carried.BACK
        owner = str(uuid4())
        try:
            with self._context.database.writing() as session:
                # A unique index holds one that runs of each machine: of two who begin at once the
                # database refuses the later one.
                if not begin_analysis(session, analysis_id, owner, self._context.now()):
                    return Carried.OVER
        except IntegrityError:
            return Carried.BUSY
        log.info("analysis %d begins", analysis_id)
        try:
            update = self._run(analysis_id, owner)
        except Exception as error:
            log.exception("analysis %d could not be followed", analysis_id)
            update = JobUpdate("failed", f"unexpected error: {type(error).__name__}: {error}")
        if update is not None:
            self._store(analysis_id, owner, update)
        elif self._stop.is_set():
            return self._give_back(analysis_id, owner)
        return Carried.OVER

    def _run(self, analysis_id: int, owner: str) -> JobUpdate | None:
        """Run a job to its last update, and leave nothing of it behind."""
        url = self._context.database.engine.url.render_as_string(hide_password=False)
        job = _Job(url, analysis_id)
        try:
            job.start()
            return self._followed(job, analysis_id, owner)
        finally:
            job.end()

    def _followed(self, job: _Job, analysis_id: int, owner: str) -> JobUpdate | None:
        """Wait for a job's last update; None where nobody waits for it, or this process ends."""
        progress = JobUpdate("progress", "reading")
        beaten_at, looks = monotonic(), self._looks
        while not self._stop.is_set():
            update = job.listen(CANCEL_POLL_S)
            if update is not None and update.kind != "progress":
                return update
            progress = update or progress
            if monotonic() - beaten_at >= HEARTBEAT_S or self._looks != looks:
                beaten_at, looks = monotonic(), self._looks
                if not self._record_heartbeat(analysis_id, owner, progress):
                    return None
        return None

    def _record_heartbeat(self, analysis_id: int, owner: str, progress: JobUpdate) -> bool:
        """Write that a job is alive; False where it was cancelled, deleted or given up."""
        try:
            with self._context.database.writing() as session:
                return record_heartbeat(
                    session, analysis_id, owner, progress.progress, progress.text
                )
        except StorageUnavailable:
            return True  # it goes on; its result waits for the database

    def _give_back(self, analysis_id: int, owner: str) -> Carried:
        """Let others have a job; where the database is away, they find out by themselves."""
        try:
            with self._context.database.writing() as session:
                back = give_back(session, analysis_id, owner)
        except StorageUnavailable:
            return Carried.BACK
        return Carried.BACK if back else Carried.OVER

    def _store(self, analysis_id: int, owner: str, update: JobUpdate) -> None:
        """Store a result or a reason; where the database is away, as soon as it is back."""
        while True:
            now = self._context.now()
            try:
                with self._context.database.writing() as session:
                    if update.kind == "done":
                        ended = finish_analysis(session, analysis_id, owner, update.text, now)
                    else:
                        ended = fail_analysis(session, analysis_id, owner, update.text, now)
                    if ended:
                        machine_id = machine_of_analysis(session, analysis_id)
                        words = None if update.kind == "done" else f"failed: {update.text}"
                        note_analysis(session, machine_id, analysis_id, update.kind, now, words)
                log.info("analysis %d %s", analysis_id, update.kind)
                return
            except StorageUnavailable as error:
                log.warning("analysis %d waits to be stored: %s", analysis_id, error.detail)
                # The result is lost: nobody beats for it any more, so that it is given up and run
                # again.
                if self._stop.wait(HEARTBEAT_S):
                    return


class AbandonedAnalyses:
    """Finds what processes ran that are gone: no try of theirs beats any more.

    It is watched here, by this process' own clock: no two clocks are compared, and while the
    database was away nobody could beat.
    """

    def __init__(self, context: Context, clock: Callable[[], float] = monotonic) -> None:
        self._context = context
        self._clock = clock
        self._seen: dict[int, tuple[tuple[str, int], float]] = {}

    def look(self) -> None:
        """Put back into the queue what has not beaten for `PATIENCE_S`; what was tried often fails.

        Raises
        ------
        StorageUnavailable
            If the database is away: what was seen before counts no longer.
        """
        try:
            with self._context.database.reading() as session:
                running = running_analyses(session)
        except StorageUnavailable:
            self._seen.clear()
            raise
        now_s = self._clock()
        before, self._seen = self._seen, {}
        for number, beats in running.items():
            # What counts is how long ago the count changed, as seen from here: a process that was
            # frozen for less than `PATIENCE_S` beats once more, and goes on.
            last_beat = before.get(number)
            since_s = last_beat[1] if last_beat is not None and last_beat[0] == beats else now_s
            self._seen[number] = beats, since_s
            if now_s - since_s >= PATIENCE_S:
                self._give_up(number, *beats)

    def _give_up(self, analysis_id: int, owner: str, beats: int) -> None:
        now = self._context.now()
        with self._context.database.writing() as session:
            # Of this owner with these beats: where it has beaten since it was looked at, nothing
            # happens.
            became = give_up(session, analysis_id, owner, beats, now)
            if became is None:
                return
            words = "waits again: the process that ran it is gone"
            if became is AnalysisStatus.FAILED:
                words = "failed: the process that ran it was gone, again and again"
            machine_id = machine_of_analysis(session, analysis_id)
            note_analysis(session, machine_id, analysis_id, became, now, words)
        log.warning("analysis %d %s", analysis_id, words)


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
