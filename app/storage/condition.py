"""How a database fares, asked as it is: nothing is upgraded, repaired or written."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

from sqlalchemy import func, select, text
from sqlalchemy.orm import Session

from app.storage.analyses import running_analyses
from app.storage.database import Database
from app.storage.limits import UNLIMITED
from app.storage.migrate import check_not_newer
from app.storage.records import AnalysisStatus
from app.storage.tables import AnalysisRow


@dataclass(frozen=True, slots=True)
class Space:
    """What a database takes, and what is free beside it [bytes]; None where that is not known."""

    taken_bytes: int
    free_bytes: int | None


@dataclass(frozen=True, slots=True)
class Queue:
    """Analyses that wait, since when the oldest does, and how far those that run are.

    `running` is of each analysis that runs, by its number: whose try it is, and its beats, which
    grow for as long as that lives.
    """

    waiting: int
    oldest_at: datetime | None
    running: dict[int, tuple[str, int]]


def revision_of(database: Database) -> str | None:
    """Read a database's revision, None where it holds nothing of thermap.

    Raises
    ------
    StorageTooNew
        If this version does not know it.
    StorageUnavailable
        If it cannot be read.
    """
    with database.reading() as session:
        return check_not_newer(session.connection(), f"the database {database.name}")


def damage(database: Database) -> list[str]:
    """List what SQLite finds wrong when it reads all of a file; a server looks after itself."""
    if not database.is_sqlite:
        return []
    problems: list[str] = []
    with database.reading(UNLIMITED) as session:
        for pragma in ("integrity_check", "foreign_key_check"):
            rows = session.connection().exec_driver_sql(f"PRAGMA {pragma}").all()
            problems += [
                " ".join(map(str, row)) if pragma == "integrity_check" else f"{row[0]}: {row[2]}"
                for row in rows
                if tuple(row) != ("ok",)
            ]
    return problems


def space(database: Database) -> Space:
    """Say how large a database is, and how much is free on the disk of a file."""
    if not database.is_sqlite:
        with database.reading() as session:
            taken = session.scalar(text("SELECT pg_database_size(current_database())"))
        return Space(int(taken or 0), None)
    file = _file_of(database)
    parts = [file, *(Path(f"{file}{end}") for end in ("-wal", "-shm"))]
    taken_bytes = sum(part.stat().st_size for part in parts if part.exists())
    return Space(taken_bytes, free_bytes(database))


def free_bytes(database: Database) -> int | None:
    """Say how much is free on the disk of a file [bytes]; None where that is not known."""
    if not database.is_sqlite:
        return None
    try:
        return shutil.disk_usage(_file_of(database).absolute().parent).free
    except OSError:  # its folder is gone
        return None


def _file_of(database: Database) -> Path:
    return Path(str(database.engine.url.database))


def clock_ahead(database: Database, now: Callable[[], datetime]) -> timedelta | None:
    """Say by how much a server's clock is ahead of `now`; None where both are this computer's."""
    if database.is_sqlite:
        return None
    with database.reading() as session:
        session.connection()  # what takes long is not asked for between the clocks
        before = now()
        server: datetime = session.execute(text("SELECT clock_timestamp()")).scalar_one()
        # The server looked at its clock somewhere between; half way is off by half of the time that
        # it took at most.
        return server - (before + (now() - before) / 2)


def queue(session: Session) -> Queue:
    """Say which analyses wait and run."""
    waiting, oldest_at = session.execute(
        select(func.count(), func.min(AnalysisRow.created_at)).where(
            AnalysisRow.status == AnalysisStatus.QUEUED
        )
    ).one()
    return Queue(waiting, oldest_at, running_analyses(session))
