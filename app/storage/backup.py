"""Backups: one SQLite file with everything, whatever kind of database it comes from.

So a backup can be read and checked with any SQLite, served as it is, and restored into
either kind of database. A seal at its end, behind what SQLite reads, holds the checksum of
all before it: a copy that was cut off, or of which a byte has changed, is known as such.
"""

from __future__ import annotations

import hashlib
import os
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final
from urllib.parse import quote

from sqlalchemy import Connection, Table, create_engine, delete, func, inspect, select, text

from app.errors import Conflict, InvalidContent, StorageUnavailable, counted
from app.storage.database import Database
from app.storage.migrate import check_not_newer, newest_revision, upgrade
from app.storage.restored_keys import (
    RestoredKeys,
    keys_before,
    note_restored_keys,
    restore_keys,
)
from app.storage.tables import Base, BrowserSessionRow

SEAL: Final = b"thermap backup 1\n"
"""What the last bytes of a backup begin with; the SHA-256 of all before follows."""

SEAL_BYTES: Final = len(SEAL) + hashlib.sha256().digest_size

MANY_ROWS: Final = 5000
"""Readings that are in memory at the same time."""

FEW_ROWS: Final = 10
"""The same of tables with arrays: one row may have some megabytes."""

COUNTED: Final = {
    "machines": "machine",
    "maps": "error_map",
    "versions": "model_version",
    "readings": "reading",
    "verifications": "verification",
    "analyses": "analysis",
}


KEYS: Final = "access_key"
SESSIONS: Final = "browser_session"
"""A table that no backup has and none restores: who was logged in then is not who is now."""


_NOT_REPLACED: Final = (KEYS, SESSIONS)


@dataclass(frozen=True, slots=True)
class BackupContents:
    """How much of each there is in a backup, and its size [bytes]."""

    counts: Mapping[str, int]
    size_bytes: int


@dataclass(frozen=True, slots=True)
class Restored:
    """What was in a backup that was restored, and what became of keys."""

    contents: BackupContents
    keys: RestoredKeys


def write_backup(database_url: str, file: Path) -> BackupContents:
    """Write everything, as it is at one moment, to a file; others may go on writing meanwhile.

    The file has its name only when it is whole.

    Raises
    ------
    Conflict
        If there is such a file, or the database is of another version than this thermap.
    StorageTooNew
        If it is of a newer one.
    StorageUnavailable
        If the database cannot be read, or the file not written.
    """
    if file.exists():
        raise Conflict(f"{file} is there already: give another name")
    part = file.with_name(f".{file.name}.{os.getpid()}.part")
    with _as_write_errors(file):
        database = Database(database_url, may_be_new=False)
        try:
            _require_tables(database)
            if database.is_sqlite:
                _copy_file(database, part)
            else:
                _copy_server(database, part)
            counts = _checked(part)
            _seal(part)
            _give_name(part, file)
        finally:
            database.close()
            for remnant in (part, *(Path(f"{part}{end}") for end in ("-wal", "-shm", "-journal"))):
                remnant.unlink(missing_ok=True)
        return BackupContents(counts, file.stat().st_size)


def restore_backup(
    database_url: str, file: Path, *, replace: bool = False, with_keys: bool = False
) -> Restored:
    """Store everything of a backup: whole, or not at all.

    Keys are the database's own where it has or had any (`app.storage.restored_keys`).

    Parameters
    ----------
    database_url
        The database; its tables are made or upgraded first.
    replace
        Whether machines that are there are replaced, with all that belongs to them.
    with_keys
        Whether keys come back that the database does not have although it has or had keys.

    Raises
    ------
    InvalidContent
        If the file is no backup, or damaged.
    StorageTooNew
        If it, or the database, is of a newer thermap.
    Conflict
        If the database has machines, or a service is running on it.
    """
    size_bytes = check_backup(file)
    with TemporaryDirectory(prefix="thermap-") as folder, _up_to_date(file, Path(folder)) as source:
        database = Database(database_url)
        try:
            upgrade(database)
            with database.alone() as target:
                _expect_no_machines(target, database.name, replace)
                before = keys_before(target)
                target.execute(delete(BrowserSessionRow))
                tables = [t for t in Base.metadata.sorted_tables if t.name not in _NOT_REPLACED]
                # In the order of foreign keys: what points to others goes first and comes last.
                for table in reversed(tables):
                    target.execute(table.delete())
                for table in tables:
                    _copy_rows(source, target, table)
                keys = restore_keys(source, target, before, with_keys=with_keys)
                numbers = _last_numbers(source)
                # Keys are not replaced: the target's own stay, and their numbers must not be given
                # again.
                numbers[KEYS] = max(numbers[KEYS], _last_numbers(target)[KEYS])
                _continue_numbers(target, numbers)
                note_restored_keys(target, keys, datetime.now(UTC))
        finally:
            database.close()
        return Restored(BackupContents(_counts(source), size_bytes), keys)


def check_backup(file: Path) -> int:
    """Say how many bytes a backup has, if it is one and whole.

    Raises
    ------
    InvalidContent
        If it is none, or not as it was written.
    """
    try:
        size_bytes = file.stat().st_size
        with file.open("rb") as opened:
            digest = hashlib.sha256()
            remaining = max(size_bytes - SEAL_BYTES, 0)
            while remaining and (read := opened.read(min(1 << 20, remaining))):
                digest.update(read)
                remaining -= len(read)
            seal = opened.read()
    except OSError as error:
        raise InvalidContent(f"{file} cannot be read: {error.strerror}") from error
    if not seal.startswith(SEAL) or len(seal) != SEAL_BYTES:
        raise InvalidContent(
            f"{file} is no backup, or not whole: expected a file that `thermap backup` wrote"
        )
    if seal != SEAL + digest.digest():
        raise InvalidContent(f"{file} is damaged: it is not as `thermap backup` wrote it")
    return size_bytes


def _expect_no_machines(target: Connection, name: str, replace: bool) -> None:
    there = target.execute(text("SELECT count(*) FROM machine")).scalar_one()
    if there and not replace:
        raise Conflict(
            f"the database {name} has {counted(there, 'machine')}: "
            "--replace deletes what is there and restores the backup in its place"
        )


def _require_tables(database: Database) -> None:
    """Refuse a database that a newer thermap wrote, or none."""
    with database.reading() as session:
        if check_not_newer(session.connection(), f"the database {database.name}") is None:
            raise Conflict(f"the database {database.name} holds nothing of thermap")


def _copy_file(database: Database, part: Path) -> None:
    """Let SQLite copy a file: readers and writers go on, and the copy is of one moment."""
    with database.driver() as driver:
        driver.execute("VACUUM INTO ?", [str(part)])
    with closing(sqlite3.connect(part, isolation_level=None)) as copy:
        if copy.execute("SELECT 1 FROM sqlite_master WHERE name = ?", [SESSIONS]).fetchone():
            copy.execute(f"DELETE FROM {SESSIONS}")


def _copy_server(database: Database, part: Path) -> None:
    """Copy all tables of a server into a file, as they are at one moment."""
    target = Database(f"sqlite:///{part.absolute()}")
    try:
        upgrade(target)
        with database.snapshot() as source, target.migrating() as connection:
            revision = check_not_newer(source, f"the database {database.name}")
            if revision != newest_revision():
                raise Conflict(
                    f"the database {database.name} is of an older thermap (revision {revision}): "
                    "start `thermap serve` once, which upgrades it, or use the older one"
                )
            for table in Base.metadata.sorted_tables:
                if table.name != SESSIONS:
                    _copy_rows(source, connection, table)
            _continue_numbers(connection, _last_numbers(source))
        with target.driver() as driver:
            driver.execute("PRAGMA journal_mode = DELETE")  # one file, without a log beside it
    finally:
        target.close()


def _copy_rows(source: Connection, target: Connection, table: Table) -> None:
    """Copy a table in pieces that fit into memory, in the order of its key."""
    rows = MANY_ROWS if table.name in ("reading", "model_version_map") else FEW_ROWS
    reading = source.execution_options(yield_per=rows)
    insert = table.insert()
    for some in reading.execute(select(table).order_by(*table.primary_key)).partitions():
        target.execute(insert, [dict(row._mapping) for row in some])


def _numbered() -> list[Table]:
    return [t for t in Base.metadata.sorted_tables if t.autoincrement_column is not None]


def _last_numbers(source: Connection) -> dict[str, int]:
    """Say which number of each numbered table was given last, also where its row is gone."""
    on_sqlite = source.dialect.name == "sqlite"
    rows = source.execute(text("SELECT name, seq FROM sqlite_sequence")) if on_sqlite else ()
    last: dict[str, int] = {row.name: row.seq for row in rows}
    for table in _numbered():
        in_table = source.execute(select(func.max(table.c.id))).scalar_one() or 0
        if not on_sqlite:
            # A sequence that was never asked for a number states 1 as well.
            last_value = text(f"SELECT last_value FROM {table.name}_id_seq WHERE is_called")
            last[table.name] = source.execute(last_value).scalar() or 0
        last[table.name] = max(in_table, last.get(table.name, 0))
    return last


def _continue_numbers(target: Connection, last: Mapping[str, int]) -> None:
    """Let new rows have numbers above all that were ever given."""
    for table in _numbered():
        number = last.get(table.name, 0)
        if target.dialect.name == "postgresql":
            target.execute(
                text("SELECT setval(:sequence, :next, false)"),
                {"sequence": f"{table.name}_id_seq", "next": number + 1},
            )
        elif table.dialect_options["sqlite"]["autoincrement"]:
            row = {"name": table.name, "seq": number}
            target.execute(text("DELETE FROM sqlite_sequence WHERE name = :name"), row)
            target.execute(text("INSERT INTO sqlite_sequence VALUES (:name, :seq)"), row)


@contextmanager
def _up_to_date(file: Path, folder: Path) -> Iterator[Connection]:
    """Open a backup at this version's revision; an older one is upgraded in a copy."""
    with _opened(file) as connection:
        if check_not_newer(connection, f"the backup {file}") == newest_revision():
            yield connection
            return
    copy = folder / "upgraded.db"
    with closing(sqlite3.connect(_uri(file), uri=True)) as older:
        older.execute("VACUUM INTO ?", [str(copy)])
    database = Database(f"sqlite:///{copy}")
    try:
        upgrade(database)
        with database.snapshot() as connection:
            yield connection
    finally:
        database.close()


@contextmanager
def _opened(file: Path) -> Iterator[Connection]:
    """Open a SQLite file as it is, without leaving anything beside it."""
    engine = create_engine("sqlite://", creator=lambda: sqlite3.connect(_uri(file), uri=True))
    try:
        with engine.connect() as connection:
            yield connection
    finally:
        engine.dispose()


def _uri(file: Path) -> str:
    return f"file:{quote(str(file.absolute()))}?mode=ro&immutable=1"


def _checked(part: Path) -> dict[str, int]:
    """Count what is in a new backup, once SQLite has looked through all of it."""
    with _opened(part) as connection:
        for pragma in ("integrity_check", "foreign_key_check"):
            answer = connection.exec_driver_sql(f"PRAGMA {pragma}").all()
            if answer not in ([], [("ok",)]):
                raise StorageUnavailable(f"the database is damaged: {pragma} found {answer[:3]}")
        return _counts(connection)


def _counts(connection: Connection) -> dict[str, int]:
    """Count what a person knows of; an older backup has not all tables."""
    there = inspect(connection).get_table_names()
    return {
        name: connection.execute(text(f"SELECT count(*) FROM {table}")).scalar_one()
        for name, table in COUNTED.items()
        if table in there
    }


def _seal(part: Path) -> None:
    """Write the checksum behind a file that is whole, and wait for the disk."""
    with part.open("r+b") as opened:
        digest = hashlib.sha256()
        while read := opened.read(1 << 20):
            digest.update(read)
        opened.write(SEAL + digest.digest())
        opened.flush()
        os.fsync(opened.fileno())


def _give_name(part: Path, file: Path) -> None:
    """Let a whole file appear under its name, but never in place of another."""
    try:
        # A link is never made in place of a file; a file that is renamed takes that place without a
        # word.
        os.link(part, file)
    except FileExistsError:
        raise Conflict(f"{file} is there already: give another name") from None
    except OSError:  # a file system without links
        part.rename(file)


@contextmanager
def _as_write_errors(file: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, sqlite3.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise StorageUnavailable(f"the backup {file} cannot be written: {reason}") from error
