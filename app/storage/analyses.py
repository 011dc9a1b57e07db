"""Analyses in the database: a queue that several service processes share.

A job is claimed by one of them, which from then on makes it beat. All that changes a job
does so only from the status that it expects: what was cancelled or deleted meanwhile stays so.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Any

from sqlalchemy import CursorResult, func, select, update
from sqlalchemy.orm import Session, undefer

from app.errors import UnknownThing, existing_names
from app.status.machine_status import RunningAnalysis
from app.storage.records import LARGEST_INTEGER, AnalysisStatus, AnalysisTask, StoredAnalysis
from app.storage.tables import AnalysisRow


def insert_analysis(
    session: Session, machine_id: str, task: AnalysisTask, now: datetime
) -> StoredAnalysis:
    """Put an analysis at the end of the queue."""
    row = AnalysisRow(
        machine_id=machine_id,
        model_version=task.model_version,
        verification_ids=list(task.verification_ids),
        holdout_fraction=task.holdout_fraction,
        kinds=None if task.kinds is None else list(task.kinds),
        seed=task.seed,
        status=AnalysisStatus.QUEUED,
        progress=0.0,
        message="waits for its turn",
        created_at=now,
        beats=0,
    )
    session.add(row)
    session.flush()
    return stored_analysis(row)


def find_analysis(
    session: Session, machine_id: str, analysis_id: int, *, result: bool = False
) -> AnalysisRow:
    """Find an analysis by its number, with its result if that is needed."""
    options = [undefer(AnalysisRow.result)] if result else []
    can_be = 0 < analysis_id <= LARGEST_INTEGER
    row = session.get(AnalysisRow, analysis_id, options=options) if can_be else None
    if row is None or row.machine_id != machine_id:
        existing = existing_names(str(a.id) for a in list_analyses(session, machine_id))
        raise UnknownThing(f"machine {machine_id!r} has no analysis {analysis_id}; {existing}")
    return row


def read_analysis(session: Session, analysis_id: int) -> StoredAnalysis | None:
    """Read an analysis of any machine, None where it is gone."""
    row = session.get(AnalysisRow, analysis_id)
    return None if row is None else stored_analysis(row)


def list_analyses(session: Session, machine_id: str) -> list[StoredAnalysis]:
    """List a machine's analyses in the order in which they were asked for."""
    query = select(AnalysisRow).where(AnalysisRow.machine_id == machine_id).order_by(AnalysisRow.id)
    return [stored_analysis(row) for row in session.scalars(query)]


def claim_analysis(session: Session, owner: str, now: datetime) -> int | None:
    """Take the first analysis of the queue, None where it is empty.

    Of several processes that ask at once each gets another one.
    """
    query = (
        select(AnalysisRow)
        .where(AnalysisRow.status == AnalysisStatus.QUEUED)
        .order_by(AnalysisRow.id)
        .limit(1)
        .with_for_update(skip_locked=True)
    )
    row = session.scalar(query)
    if row is None:
        return None
    row.status = AnalysisStatus.RUNNING
    row.owner = owner
    row.started_at = now
    row.message = "begins"
    return row.id


def record_heartbeat(
    session: Session, analysis_id: int, owner: str, progress: float, message: str
) -> bool:
    """Say that a job is alive, and how far; False where it is not this owner's to run any more."""
    return _change(
        session,
        analysis_id,
        {"beats": AnalysisRow.beats + 1, "progress": progress, "message": message},
        AnalysisRow.status == AnalysisStatus.RUNNING,
        AnalysisRow.owner == owner,
    )


def finish_analysis(
    session: Session, analysis_id: int, owner: str, result: str, now: datetime
) -> bool:
    """Store a result as JSON text; False where nobody waits for it any more."""
    return _change(
        session,
        analysis_id,
        {
            "status": AnalysisStatus.DONE,
            "progress": 1.0,
            "message": "done",
            "result": result,
            "finished_at": now,
        },
        AnalysisRow.status == AnalysisStatus.RUNNING,
        AnalysisRow.owner == owner,
    )


def fail_analysis(
    session: Session, analysis_id: int, owner: str, beats: int | None, reason: str, now: datetime
) -> bool:
    """Say why a job has no result; with `beats`, only if it has not beaten since."""
    also = [] if beats is None else [AnalysisRow.beats == beats]
    return _change(
        session,
        analysis_id,
        {"status": AnalysisStatus.FAILED, "message": reason, "finished_at": now},
        AnalysisRow.status == AnalysisStatus.RUNNING,
        AnalysisRow.owner == owner,
        *also,
    )


def cancel_analysis(session: Session, analysis_id: int, now: datetime) -> bool:
    """Cancel a job that waits or runs; False where it does neither."""
    return _change(
        session,
        analysis_id,
        {"status": AnalysisStatus.CANCELLED, "message": "cancelled", "finished_at": now},
        AnalysisRow.status.in_([AnalysisStatus.QUEUED, AnalysisStatus.RUNNING]),
    )


def machine_of_analysis(session: Session, analysis_id: int) -> str | None:
    """Say whose analysis it is; None where it was deleted."""
    return session.scalar(select(AnalysisRow.machine_id).where(AnalysisRow.id == analysis_id))


def running_analyses(session: Session) -> dict[int, tuple[str, int]]:
    """Give the jobs that run, anywhere: number to owner and beats."""
    query = select(AnalysisRow.id, AnalysisRow.owner, AnalysisRow.beats).where(
        AnalysisRow.status == AnalysisStatus.RUNNING
    )
    return {number: (owner or "", beats) for number, owner, beats in session.execute(query)}


def unfinished_analyses(session: Session) -> dict[str, RunningAnalysis]:
    """Give the oldest analysis of each machine that waits or runs."""
    query = (
        select(AnalysisRow.machine_id, AnalysisRow.id, AnalysisRow.progress)
        .where(AnalysisRow.status.in_([AnalysisStatus.QUEUED, AnalysisStatus.RUNNING]))
        .order_by(AnalysisRow.id.desc())
    )
    # The oldest comes last, and stays.
    return {m: RunningAnalysis(number, share) for m, number, share in session.execute(query)}


def count_analyses(session: Session) -> dict[str, int]:
    """Count all machines' analyses by status."""
    counted = func.count().label("counted")
    query = select(AnalysisRow.status, counted).group_by(AnalysisRow.status)
    return {row.status: row.counted for row in session.execute(query)}


def has_queued(session: Session) -> bool:
    """Whether anything waits."""
    query = select(AnalysisRow.id).where(AnalysisRow.status == AnalysisStatus.QUEUED).limit(1)
    return session.scalar(query) is not None


def stored_analysis(row: AnalysisRow) -> StoredAnalysis:
    """Read a row without its result."""
    return StoredAnalysis(
        id=row.id,
        machine_id=row.machine_id,
        task=AnalysisTask(
            model_version=row.model_version,
            verification_ids=row.verification_ids,
            holdout_fraction=row.holdout_fraction,
            kinds=row.kinds,
            seed=row.seed,
        ),
        status=AnalysisStatus(row.status),
        progress=row.progress,
        message=row.message,
        created_at=row.created_at,
        started_at=row.started_at,
        finished_at=row.finished_at,
        adopted_version=row.adopted_version,
    )


def _change(
    session: Session, analysis_id: int, values: Mapping[str, Any], *conditions: Any
) -> bool:
    statement = update(AnalysisRow).where(AnalysisRow.id == analysis_id, *conditions)
    done = session.execute(statement.values(**values))
    assert isinstance(done, CursorResult)
    return done.rowcount == 1
