"""One analysis in a process of its own: live tables must not wait for it.

What analyses is imported where it is used. That alone takes two seconds of processor time, and
many more on a busy machine; before that the process stands behind the live tables, and sees when
whoever began it is gone.
"""

from __future__ import annotations

import logging
import os
import signal
import threading
from contextlib import suppress
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from time import monotonic
from typing import Final, Literal, NamedTuple

from app.errors import ThermapError

log = logging.getLogger("thermap")

PROGRESS_EVERY_S: Final = 0.2
"""Progress is reported no more often [s]."""

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
    with suppress(BrokenPipeError), to_service:  # nobody is there to be told
        to_service.send(_carried_out(database_url, analysis_id, _ProgressSender(to_service)))


def _carried_out(database_url: str, analysis_id: int, progress: _ProgressSender) -> JobUpdate:
    """Analyse, and give the last update.

    Raises
    ------
    BrokenPipeError
        If nobody listens to its progress any more.
    """
    try:
        progress(0.0, "reading")
        from app.services.analyse_stored import analyse_stored

        return JobUpdate("done", analyse_stored(database_url, analysis_id, progress))
    except BrokenPipeError:
        raise
    except ThermapError as error:
        return JobUpdate("failed", error.detail)
    except Exception as error:
        log.exception("analysis %d failed", analysis_id)
        return JobUpdate("failed", f"unexpected error: {type(error).__name__}: {error}")


class _ProgressSender:
    """Tells the service how far the analysis is, now and then."""

    def __init__(self, to_service: Connection) -> None:
        self._to_service = to_service
        self._sent_at = -PROGRESS_EVERY_S

    def __call__(self, progress: float, words: str) -> None:
        if monotonic() - self._sent_at >= PROGRESS_EVERY_S:
            self._sent_at = monotonic()
            self._to_service.send(JobUpdate("progress", words, progress))


def _exit_with_service() -> None:
    """End at once when the service is gone: nobody waits for the result."""
    service = parent_process()
    if service is not None:
        service.join()
        # An exception, as `sys.exit` raises it, would end this thread alone.
        os._exit(1)
