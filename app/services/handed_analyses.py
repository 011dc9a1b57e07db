"""Analyses that Procrastinate hands out to this process, from PostgreSQL's queue.

Procrastinate chooses who runs what, and of one machine's analyses hands out one at a time. Whether
a try is still alive is judged by its own beats: a worker of Procrastinate's that was cut off for a
while, or stopped and woken again, is given up by its heartbeat, but may still end the job of the
one that took over. So a job that was given up is never handed out again; the analysis is, by a new
one.
"""

from __future__ import annotations

import asyncio
import logging
from contextlib import suppress
from threading import Event, Lock, Thread
from typing import Any, Final

from procrastinate import App, BaseRetryStrategy, RetryDecision
from procrastinate.exceptions import ProcrastinateException
from procrastinate.jobs import Job, Status

from app.errors import StorageUnavailable
from app.services.carry_analyses import (
    PATIENCE_S,
    QUEUE_POLL_S,
    STOP_S,
    AbandonedAnalyses,
    AnalysisCarrier,
    Carried,
    Looked,
)
from app.services.context import Context
from app.storage.analyses import running_analyses, waiting_analyses
from app.storage.job_queue import QUEUE, TASK, hand_out, queue_connector
from app.storage.postgresql import DriverError

log = logging.getLogger("thermap")

WORKER_BEAT_S: Final = PATIENCE_S / 5.0
"""How often a worker of Procrastinate's says that it is alive [s]."""

AGAIN_S: Final = 1.0
"""When a queue that is away is looked for again [s]."""

_AWAY: Final = (ProcrastinateException, DriverError, StorageUnavailable, OSError)


class _Waits(Exception):
    """The analysis could not be run now; its job goes back to the queue."""


class _Later(BaseRetryStrategy):
    """Hands a job out again that could not be run now, and no other."""

    def get_retry_decision(self, *, exception: BaseException, job: Job) -> RetryDecision | None:
        """Say when."""
        if not isinstance(exception, _Waits):
            return None
        return RetryDecision(retry_in={"seconds": int(QUEUE_POLL_S)})


class HandedAnalyses:
    """Runs what it is handed, in threads begun by `start` or the first `wake`.

    Each of `concurrency` workers runs one analysis at a time and is one by itself to Procrastinate:
    what ends one does not end the others.
    """

    def __init__(self, context: Context, concurrency: int, looked: Looked) -> None:
        self._context = context
        self._looked = looked
        self._carrier = AnalysisCarrier(context)
        self._abandoned = AbandonedAnalyses(context)
        self._concurrency = concurrency
        self._ends = Event()
        self._starting = Lock()
        self._thread: Thread | None = None

    def start(self) -> None:
        """Begin, unless it has begun."""
        with self._starting:
            if self._thread is None and not self._ends.is_set():
                self._thread = Thread(target=self._run, name="analyses", daemon=True)
                self._thread.start()

    def wake(self) -> None:
        """Look at whether a running job was cancelled; of new ones PostgreSQL tells."""
        self.start()
        self._carrier.look()

    def stop(self, patience_s: float = STOP_S, *, finish_s: float = 0.0) -> None:
        """End: what runs is finished within `finish_s` [s], or given back to the queue."""
        self._ends.set()
        self._join(finish_s)
        self._carrier.stop()
        self._join(patience_s)

    def _join(self, patience_s: float) -> None:
        if self._thread is not None:
            self._thread.join(patience_s)

    def _run(self) -> None:
        # What Procrastinate says of every job is said here, in thermap's words.
        logging.getLogger("procrastinate").setLevel(logging.CRITICAL)
        logging.getLogger("psycopg.pool").setLevel(logging.ERROR)
        while not self._ends.is_set():
            try:
                asyncio.run(self._work())
            except _AWAY as error:
                log.info("the queue of analyses is away: %s", error)
                self._looked(False)
                self._ends.wait(AGAIN_S)
            except Exception:
                log.exception("could not take analyses off the queue")
                self._ends.wait(AGAIN_S)

    async def _work(self) -> None:
        """Open the queue, and work until the end."""
        app = App(connector=queue_connector(self._context.database, self._concurrency + 2))
        app.task(name=TASK, queue=QUEUE, retry=_Later())(self._carry_out)
        asyncio.get_running_loop().set_exception_handler(_say_unexpected)
        async with app.open_async():
            workers = [
                asyncio.create_task(self._worker(app), name=f"analyses {i}")
                for i in range(self._concurrency)
            ]
            watch = asyncio.create_task(self._watch(app))
            try:
                while not self._ends.is_set():
                    await asyncio.sleep(0.1)
                    _expect_alive(workers)
            finally:
                # A worker that is cancelled takes no more, and waits for what it runs.
                for worker in workers:
                    worker.cancel()
                await asyncio.gather(*workers, return_exceptions=True)
                watch.cancel()
                await asyncio.gather(watch, return_exceptions=True)

    async def _worker(self, app: App) -> None:
        """Be a worker; one that lost the database ends by itself, and begins anew."""
        while not self._ends.is_set():
            try:
                await app.run_worker_async(
                    queues=[QUEUE],
                    install_signal_handlers=False,
                    fetch_job_polling_interval=QUEUE_POLL_S,
                    update_heartbeat_interval=WORKER_BEAT_S,
                    stalled_worker_timeout=PATIENCE_S,
                    delete_jobs="always",
                )
            except _AWAY as error:
                log.info("a worker lost the queue of analyses: %s", error)
            await asyncio.sleep(AGAIN_S)

    def _carry_out(self, analysis_id: int) -> None:
        """Run what was handed out, in a thread of its own."""
        if self._carrier.carry_out(analysis_id) is not Carried.OVER:
            raise _Waits

    async def _watch(self, app: App) -> None:
        """Give up what others ran and no longer run, and hand out what nobody has."""
        while True:
            try:
                # In this order: what is given up waits again, its old job is ended, and then it is
                # seen to have none. In threads, as the workers' signs of life are sent by this
                # loop.
                await asyncio.to_thread(self._abandoned.look)
                await self._end_stalled(app)
                await self._hand_out_forgotten(app)
                self._looked(True)
            except _AWAY:
                self._looked(False)  # whoever waits for the database says so
            except Exception:
                log.exception("could not look for abandoned analyses")
            await asyncio.sleep(QUEUE_POLL_S)

    async def _end_stalled(self, app: App) -> None:
        """End the jobs of workers that are gone, but for those whose try beats all the same."""
        stalled = await app.job_manager.get_stalled_jobs(
            task_name=TASK, seconds_since_heartbeat=PATIENCE_S
        )
        if not (jobs := list(stalled)):
            return
        runs = await asyncio.to_thread(self._running)
        for job in jobs:
            # To Procrastinate a worker that was cut off for a while is gone, too: as long as its
            # analysis runs, by that one's own beats, its job stays.
            if _analysis_of(job) not in runs:
                with suppress(ProcrastinateException):  # another one ended it first
                    await app.job_manager.finish_job(job, Status.FAILED, delete_job=True)

    async def _hand_out_forgotten(self, app: App) -> None:
        """Hand out what waits and has no job: given up, restored, or asked of an older service.

        What waits is read first. Where two processes hand the same out, the second try finds
        nothing to do.
        """
        waiting = await asyncio.to_thread(self._waiting)
        if not waiting:
            return
        # In this order: a job that is taken between the two questions is in the second answer.
        for status in (Status.TODO, Status.DOING):
            for job in await app.job_manager.list_jobs_async(task=TASK, status=status.value):
                waiting.pop(_analysis_of(job), None)
        if waiting:
            await asyncio.to_thread(self._hand_out, waiting)

    def _running(self) -> set[int]:
        with self._context.database.reading() as session:
            return set(running_analyses(session))

    def _waiting(self) -> dict[int, str]:
        with self._context.database.reading() as session:
            return waiting_analyses(session)

    def _hand_out(self, waiting: dict[int, str]) -> None:
        with self._context.database.writing() as session:
            for number, machine_id in waiting.items():
                hand_out(session, number, machine_id)


def _expect_alive(workers: list[asyncio.Task[None]]) -> None:
    """Raise what ended a worker: without it nothing would be taken off the queue, unsaid."""
    for worker in workers:
        if worker.done():
            worker.result()


def _say_unexpected(loop: asyncio.AbstractEventLoop, about: dict[str, Any]) -> None:
    """Leave unsaid that a worker could not end a job: others ended it, or will."""
    if not isinstance(about.get("exception"), ProcrastinateException):
        loop.default_exception_handler(about)


def _analysis_of(job: Job) -> Any:
    return job.task_kwargs.get("analysis_id")
