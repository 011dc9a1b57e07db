"""One analysis in a process of its own: live tables must not wait for it."""

from __future__ import annotations

import logging
import os
import signal
import threading
from contextlib import suppress
from dataclasses import replace
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from time import monotonic
from typing import Final, Literal, NamedTuple

from app.errors import Conflict, ThermapError
from app.identification.analysis.analyse import analyse
from app.services.change_model import choose_version
from app.services.context import CLOCKS_DIFFER
from app.services.residuals import load_campaign, read_verifications
from app.storage.analyses import read_analysis
from app.storage.analysis_results import RESULTS
from app.storage.database import Database
from app.storage.limits import LONG

log = logging.getLogger("thermap")

PROGRESS_EVERY_S: Final = 0.2
"""Progress is told no more often [s]."""

BEHIND_TABLES: Final = 5
"""How much the system favours other processes, the service's live tables among them."""


class JobUpdate(NamedTuple):
    """What the process tells the service: how far it is, its result as JSON, or why it has none."""

    kind: Literal["progress", "done", "failed"]
    text: str
    progress: float = 0.0


def run_analysis(database_url: str, analysis_id: int, to_service: Connection) -> None:
    """Carry a claimed analysis out; the target of the process.

    Parameters
    ----------
    database_url
        Where verifications, readings and the model are; nothing is written there.
    to_service
        Where `JobUpdate` go; the last one is `done` or `failed`.
    """
    # Ctrl-C reaches the whole group of processes; the service is the one that ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_exit_with_service, daemon=True).start()
    with suppress(OSError, AttributeError):
        os.nice(BEHIND_TABLES)
    try:
        update = JobUpdate(
            "done", _analysed(database_url, analysis_id, _ProgressSender(to_service))
        )
    except ThermapError as error:
        update = JobUpdate("failed", error.detail)
    except Exception as error:
        log.exception("analysis %d failed", analysis_id)
        update = JobUpdate("failed", f"unexpected error: {type(error).__name__}: {error}")
    to_service.send(update)
    to_service.close()


class _ProgressSender:
    """Tells the service how far the analysis is, now and then."""

    def __init__(self, to_service: Connection) -> None:
        self._to_service = to_service
        self._sent_at = -PROGRESS_EVERY_S

    def __call__(self, progress: float, words: str) -> None:
        if monotonic() - self._sent_at >= PROGRESS_EVERY_S:
            self._sent_at = monotonic()
            self._to_service.send(JobUpdate("progress", words, progress))


def _analysed(database_url: str, analysis_id: int, progress: _ProgressSender) -> str:
    progress(0.0, "reading")
    database = Database(database_url, LONG, may_be_new=False)
    try:
        with database.reading() as session:
            stored = read_analysis(session, analysis_id)
            if stored is None:
                raise Conflict("it was deleted")
            machine, version = choose_version(session, stored.machine_id, stored.task.model_version)
            ids = stored.task.verification_ids
            verifications = read_verifications(session, stored.machine_id, ids)
            until = stored.created_at + CLOCKS_DIFFER
            campaign = load_campaign(
                session, machine, version, verifications, until, searching=True
            )
            campaign = replace(campaign, verification_ids=tuple(ids))
    finally:
        database.close()
    found = analyse(
        campaign,
        holdout_fraction=stored.task.holdout_fraction,
        kinds=stored.task.kinds,
        seed=stored.task.seed,
        progress=progress,
    )
    return RESULTS.text(found)


def _exit_with_service() -> None:
    """End at once when the service is gone: nobody waits for the result."""
    service = parent_process()
    if service is not None:
        service.join()
        os._exit(1)
