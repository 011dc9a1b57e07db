"""Analyses in the database, as jobs that several processes share.

A job is begun by one of them, which from then on makes it beat; of a machine's jobs one runs at
a time. All that changes a job does so only from the status, and the try, that it expects: what
was cancelled, deleted or taken up by others meanwhile stays so.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Any, Final

from sqlalchemy import CursorResult, func, select, update
from sqlalchemy.orm import Session, aliased, undefer

from app.errors import UnknownThing, existing_names
from app.status.machine_status import NotAdopted, RunningAnalysis
from app.storage.analysis_results import confirmed_effects
from app.storage.records import LARGEST_INTEGER, AnalysisStatus, AnalysisTask, StoredAnalysis
from app.storage.tables import AnalysisRow, MachineRow

#              begin_analysis              finish_analysis
#    queued ───────────────────> running ───────────────────> done
#     │ ^ ^                       │ │ │    fail_analysis
#     │ │ └──── give_back ────────┘ │ ├───────────────────> failed
#     │ │                           │ │    give_up, the third time
#     │ └────── give_up ────────────┘ │
#     │        (no beat since)        │    cancel_analysis
#     └───────────────────────────────┴───────────────────> cancelled
#
# Every arrow is one UPDATE that names the status, the owner and, for `give_up`, the number of beats
# that it expects, and counts the rows that it changed: of two processes that want different things
# the second changes none. That of one machine no two run is an index of the table.
MOST_TRIES: Final = 3
"""How often an analysis is begun whose process, each time, is then gone without a word."""

WAITS: Final = "waits for its turn"


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
        message=WAITS,
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


def next_analysis(session: Session) -> int | None:
    """Name the first analysis that waits and whose machine has none that runs; None: nothing to do.

    It may be another's before it is begun.
    """
    other = aliased(AnalysisRow)
    runs = select(other.id).where(
        other.machine_id == AnalysisRow.machine_id, other.status == AnalysisStatus.RUNNING
    )
    query = select(AnalysisRow.id).where(
        AnalysisRow.status == AnalysisStatus.QUEUED, ~runs.exists()
    )
    return session.scalar(query.order_by(AnalysisRow.id).limit(1))


def begin_analysis(session: Session, analysis_id: int, owner: str, now: datetime) -> bool:
    """Begin a try of an analysis that waits; False where it does not wait any more.

    Raises
    ------
    sqlalchemy.exc.IntegrityError
        If another one of its machine runs.
    """
    return _change(
        session,
        analysis_id,
        {
            "status": AnalysisStatus.RUNNING,
            "owner": owner,
            "started_at": now,
            "message": "begins",
            "tries": AnalysisRow.tries + 1,
        },
        AnalysisRow.status == AnalysisStatus.QUEUED,
    )


def give_back(session: Session, analysis_id: int, owner: str) -> bool:
    """Put a job that runs back into the queue, as if it had not been begun."""
    again = {"tries": AnalysisRow.tries - 1, "message": WAITS}
    return _change(session, analysis_id, {**_WAITING, **again}, *_runs_by(owner))


def give_up(
    session: Session, analysis_id: int, owner: str, beats: int, now: datetime
) -> AnalysisStatus | None:
    """Put a job back into the queue that has not beaten since; None where it has.

    The last time it fails instead.
    """
    gone = [*_runs_by(owner), AnalysisRow.beats == beats]
    tried = session.scalar(select(AnalysisRow.tries).where(AnalysisRow.id == analysis_id, *gone))
    if tried is None:
        return None
    if tried >= MOST_TRIES:
        reason = f"begun {tried} times, and each time the process that ran it was gone"
        failed = {"status": AnalysisStatus.FAILED, "message": reason, "finished_at": now}
        return AnalysisStatus.FAILED if _change(session, analysis_id, failed, *gone) else None
    reason = f"waits again: the process that ran it is gone (begun {tried} of {MOST_TRIES} times)"
    back = _change(session, analysis_id, {**_WAITING, "message": reason}, *gone)
    return AnalysisStatus.QUEUED if back else None


def record_heartbeat(
    session: Session, analysis_id: int, owner: str, progress: float, message: str
) -> bool:
    """Say that a job is alive, and how far; False where it is not this owner's to run any more."""
    return _change(
        session,
        analysis_id,
        {"beats": AnalysisRow.beats + 1, "progress": progress, "message": message},
        *_runs_by(owner),
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
            "confirmed": confirmed_effects(result),
            "finished_at": now,
        },
        *_runs_by(owner),
    )


def fail_analysis(
    session: Session, analysis_id: int, owner: str, reason: str, now: datetime
) -> bool:
    """Say why a job has no result; False where nobody waits for it any more."""
    return _change(
        session,
        analysis_id,
        {"status": AnalysisStatus.FAILED, "message": reason, "finished_at": now},
        *_runs_by(owner),
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


def analyses_at_work(session: Session) -> list[StoredAnalysis]:
    """List the analyses that run, of all machines, without their results."""
    query = select(AnalysisRow).where(AnalysisRow.status == AnalysisStatus.RUNNING)
    return [stored_analysis(row) for row in session.scalars(query.order_by(AnalysisRow.id))]


def unfinished_analyses(session: Session) -> dict[str, RunningAnalysis]:
    """Give the oldest analysis of each machine that waits or runs."""
    query = (
        select(AnalysisRow.machine_id, AnalysisRow.id, AnalysisRow.progress)
        .where(AnalysisRow.status.in_([AnalysisStatus.QUEUED, AnalysisStatus.RUNNING]))
        .order_by(AnalysisRow.id.desc())
    )
    # The oldest comes last, and stays.
    return {m: RunningAnalysis(number, share) for m, number, share in session.execute(query)}


def analyses_not_adopted(session: Session) -> dict[str, NotAdopted]:
    """Give what the latest analysis of each machine's active version confirmed in vain.

    That is also one of which the active version has a part, as far as it was left out.
    """
    adopted = AnalysisRow.adopted_version
    version = func.coalesce(adopted, AnalysisRow.model_version)
    query = (
        select(AnalysisRow.machine_id, AnalysisRow.id, AnalysisRow.confirmed, adopted)
        .join(
            MachineRow,
            (MachineRow.id == AnalysisRow.machine_id) & (MachineRow.active_version == version),
        )
        .where(AnalysisRow.status == AnalysisStatus.DONE)
        .order_by(AnalysisRow.id)
    )
    latest = {machine: row for machine, *row in session.execute(query)}
    return {
        machine: NotAdopted(number, tuple(effects), needs_analysis=adopted_version is not None)
        for machine, (number, effects, adopted_version) in latest.items()
        if effects
    }


def count_analyses(session: Session) -> dict[str, int]:
    """Count all machines' analyses by status."""
    counted = func.count().label("counted")
    query = select(AnalysisRow.status, counted).group_by(AnalysisRow.status)
    return {row.status: row.counted for row in session.execute(query)}


def count_waiting(session: Session, machine_id: str) -> tuple[int, int]:
    """Count the analyses that wait: of a machine, and of all."""
    ours = func.count().filter(AnalysisRow.machine_id == machine_id)
    query = select(ours, func.count()).where(AnalysisRow.status == AnalysisStatus.QUEUED)
    here, all_of_them = session.execute(query).one()
    return here, all_of_them


def waiting_analyses(session: Session) -> dict[int, str]:
    """Give all analyses that wait, in their order: number to machine."""
    query = select(AnalysisRow.id, AnalysisRow.machine_id).where(
        AnalysisRow.status == AnalysisStatus.QUEUED
    )
    return {row.id: row.machine_id for row in session.execute(query.order_by(AnalysisRow.id))}


def stored_analysis(row: AnalysisRow) -> StoredAnalysis:
    """Read a row without its result."""
    return StoredAnalysis(
        id=row.id,
        machine_id=row.machine_id,
        status=AnalysisStatus(row.status),
        progress=row.progress,
        message=row.message,
        model_version=row.model_version,
        verifications=row.verification_ids,
        holdout_fraction=row.holdout_fraction,
        effects=row.kinds,
        seed=row.seed,
        created_at=row.created_at,
        started_at=row.started_at,
        finished_at=row.finished_at,
        adopted_version=row.adopted_version,
    )


_WAITING: Final[Mapping[str, Any]] = {
    "status": AnalysisStatus.QUEUED,
    "owner": None,
    "started_at": None,
    "progress": 0.0,
}
"""What a job has that is back in the queue."""


def _runs_by(owner: str) -> list[Any]:
    """Say that a try runs, as conditions."""
    return [AnalysisRow.status == AnalysisStatus.RUNNING, AnalysisRow.owner == owner]


def _change(
    session: Session, analysis_id: int, values: Mapping[str, Any], *conditions: Any
) -> bool:
    statement = update(AnalysisRow).where(AnalysisRow.id == analysis_id, *conditions)
    done = session.execute(statement.values(**values))
    assert isinstance(done, CursorResult)
    return done.rowcount == 1
