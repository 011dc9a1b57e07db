"""The connection to SQLite or PostgreSQL, and transactions that say when they commit."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import Any

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url
from sqlalchemy.exc import (
    ArgumentError,
    DatabaseError,
    DisconnectionError,
    InterfaceError,
    OperationalError,
)
from sqlalchemy.exc import TimeoutError as PoolTimeout
from sqlalchemy.orm import Session

from app.errors import InvalidContent, StorageBusy, StorageUnavailable

BUSY_TIMEOUT_S = 15.0
CONNECT_TIMEOUT_S = 5

_GIVE_UP = {
    "connect_timeout": CONNECT_TIMEOUT_S,
    "tcp_user_timeout": CONNECT_TIMEOUT_S * 1000,
    "keepalives_idle": CONNECT_TIMEOUT_S,
    "keepalives_interval": 1,
    "keepalives_count": CONNECT_TIMEOUT_S,
}
"""A network that swallows everything, without this, keeps a request for a quarter of an hour."""


class Database:
    """One database, reached through transactions for reading or for writing.

    On SQLite one writer of this process writes at a time, and takes the file's write lock
    at the beginning, so that writers queue instead of failing; on PostgreSQL the use cases
    lock the machine's row. Nothing is committed but by leaving `writing()` without an
    exception.
    """

    def __init__(self, url: str) -> None:
        self.engine = _make_engine(url)
        on_sqlite = self.engine.dialect.name == "sqlite"
        self._writer = Lock() if on_sqlite else None

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """Open a session that changes nothing."""
        with _saying_when_away(), Session(self.engine, expire_on_commit=False) as session:
            yield session

    @contextmanager
    def writing(self) -> Iterator[Session]:
        """Open a session that is committed at the end, or rolled back whole."""
        writer = self.engine.execution_options(thermap_writes=True)
        with (
            self._turn(),
            _saying_when_away(),
            Session(writer, expire_on_commit=False) as session,
            session.begin(),
        ):
            yield session

    @contextmanager
    def migrating(self) -> Iterator[Connection]:
        """Open a write transaction in which tables may be made anew.

        SQLite changes a table by making another and dropping the old one, which with
        foreign keys on would take all rows that refer to it along. So they are off
        here, and checked before the commit.
        """
        writer = self.engine.execution_options(thermap_writes=True)
        with self._turn(), _saying_when_away(), writer.connect() as connection:
            on_sqlite = connection.dialect.name == "sqlite"
            driver: Any = connection.connection.dbapi_connection
            if on_sqlite:
                driver.execute("PRAGMA foreign_keys = OFF")
            try:
                with connection.begin():
                    yield connection
                    if on_sqlite:
                        broken = connection.exec_driver_sql("PRAGMA foreign_key_check").all()
                        if broken:
                            raise RuntimeError(f"the migration lost what {broken[:5]} refer to")
            finally:
                if on_sqlite:
                    driver.execute("PRAGMA foreign_keys = ON")

    @contextmanager
    def _turn(self) -> Iterator[None]:
        """Wait for this process's other writers, on SQLite; StorageBusy when it takes too long."""
        if self._writer is None:
            yield
            return
        if not self._writer.acquire(timeout=BUSY_TIMEOUT_S):
            raise StorageBusy(f"the database is busy: others wrote for {BUSY_TIMEOUT_S:g} s")
        try:
            yield
        finally:
            self._writer.release()

    @property
    def name(self) -> str:
        """The URL without its password."""
        return self.engine.url.render_as_string(hide_password=True)

    def close(self) -> None:
        """Give up all connections."""
        self.engine.dispose()


def _make_engine(url: str) -> Engine:
    parsed = _parse(url)
    if parsed.drivername in ("postgresql", "postgres"):
        parsed = parsed.set(drivername="postgresql+psycopg")
    if parsed.get_backend_name() == "postgresql":
        return create_engine(
            parsed,
            pool_pre_ping=True,
            pool_size=10,
            max_overflow=30,
            pool_timeout=CONNECT_TIMEOUT_S,
            connect_args=_GIVE_UP,
        )
    if parsed.get_backend_name() != "sqlite":
        raise InvalidContent.of_field(
            "database_url",
            "expected sqlite:///FILE or postgresql://USER@HOST/DATABASE, "
            f"came {parsed.drivername}://…",
        )
    if parsed.database in (None, "", ":memory:"):
        raise InvalidContent.of_field(
            "database_url", "expected a SQLite file, came none: what is stored has to last"
        )
    file = Path(str(parsed.database)).expanduser()
    _make_folder(file.parent)
    engine = create_engine(parsed.set(database=str(file)), connect_args={"timeout": BUSY_TIMEOUT_S})
    event.listen(engine, "connect", _prepare_sqlite)
    event.listen(engine, "begin", _begin_sqlite)
    return engine


def _parse(url: str) -> URL:
    try:
        return make_url(url)
    except (ArgumentError, ValueError):
        # Not what came: it may hold a password.
        raise InvalidContent.of_field(
            "database_url",
            "expected sqlite:///FILE or postgresql://USER@HOST/DATABASE, came text that is no URL",
        ) from None


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageUnavailable(
            f"the database is away: the folder {folder} cannot be made ({error.strerror})"
        ) from error


def _prepare_sqlite(connection: sqlite3.Connection, _record: Any) -> None:
    """Make SQLite keep what was answered: log, foreign keys, and a sync at each commit."""
    connection.isolation_level = None  # we say BEGIN ourselves, see _begin_sqlite
    for pragma in (
        "journal_mode = WAL",
        "foreign_keys = ON",
        "synchronous = FULL",
        "journal_size_limit = 67108864",
    ):
        connection.execute(f"PRAGMA {pragma}")


def _begin_sqlite(connection: Connection) -> None:
    writes = connection.get_execution_options().get("thermap_writes", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


@contextmanager
def _saying_when_away() -> Iterator[None]:
    """Turn the driver's many ways of being away into one."""
    try:
        yield
    except (OperationalError, InterfaceError, DisconnectionError, PoolTimeout) as error:
        lines = str(getattr(error, "orig", None) or error).strip().splitlines()
        reason = lines[0] if lines else type(error).__name__
        if any(word in reason for word in ("locked", "deadlock", "QueuePool")):
            raise StorageBusy(f"the database is busy, try again: {reason}") from error
        raise StorageUnavailable(f"the database is away: {reason}") from error
    except DatabaseError as error:
        # SQLite says so itself, not by a subclass, of a file that is no database or is damaged.
        if type(error) is not DatabaseError:
            raise
        raise StorageUnavailable(f"the database cannot be read: {error.orig}") from error
