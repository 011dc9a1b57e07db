"""The end of the event log and the analyses that run: what those who follow both are sent."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from app.errors import StorageUnavailable
from app.events.event import SERVICE, EventKind
from app.events.news import AnalysisNews
from app.services.context import Context
from app.storage.analyses import analyses_at_work
from app.storage.events import LogTail, count_entries, read_tail
from app.storage.limits import QUESTION


@dataclass(frozen=True, slots=True)
class LogNow:
    """The end of the log, and the analyses that run, as they are at one moment."""

    tail: LogTail
    running: Sequence[AnalysisNews]


def read_log_now(context: Context, after: int | None, most: int) -> LogNow | None:
    """Read what was written after an entry, the last `most` of it; None while nobody answers.

    Parameters
    ----------
    after
        Number of the entry; None for the last ones there are.
    """
    if context.live.database.trouble is not None:
        return None
    try:
        with context.database.reading(QUESTION) as session:
            tail = read_tail(session, after, most)
            # The log first: of an analysis that it says is done nothing more is sent.
            jobs = analyses_at_work(session)
    except StorageUnavailable:
        return None
    now = context.now()
    running = [
        AnalysisNews(
            machine=job.machine_id,
            analysis=job.id,
            status="running",
            progress=job.progress,
            message=job.message,
            time=now,
            who=SERVICE,
        )
        for job in jobs
    ]
    return LogNow(tail, running)


def count_log(
    context: Context, after: int, until: int
) -> Counter[tuple[str | None, EventKind, bool]] | None:
    """Count what was written after one entry up to another; None while nobody answers."""
    if context.live.database.trouble is not None:
        return None
    try:
        with context.database.reading(QUESTION) as session:
            return count_entries(session, after, until)
    except StorageUnavailable:
        return None
