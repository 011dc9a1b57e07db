"""The database, SQLite or PostgreSQL, and transactions that say when they commit."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from secrets import token_hex
from threading import Lock
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import URL, Connection, Engine, make_url, text
from sqlalchemy.exc import (
    ArgumentError,
    DatabaseError,
    DisconnectionError,
    InterfaceError,
    OperationalError,
)
from sqlalchemy.exc import TimeoutError as PoolTimeout
from sqlalchemy.orm import Session

from app.errors import (
    Conflict,
    InvalidContent,
    StorageBusy,
    StorageFull,
    StorageOvertaken,
    StorageUnavailable,
)
from app.foreign_text import shown, without_secrets
from app.storage.access_keys import confirm_authorization
from app.storage.limits import UNLIMITED, Limits
from app.storage.log_numbers import number_entries
from app.storage.news import NewsKind, send_pending
from app.storage.sqlite import SqliteConnections

if TYPE_CHECKING:
    from app.storage.postgresql import Duty, ImpatientConnection, Listener, PostgresqlConnections

MOMENT: Final = Limits(lock_s=0.2)
"""To see whether something can be written at all."""

ALONE: Final = Limits(statement_s=None)
"""To restore a backup."""

_OTHERS: Final = text(
    "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() "
    "AND application_name = current_setting('application_name') AND pid <> pg_backend_pid()"
)
"""Connections of other processes of ours."""

LEAVES_WITHIN_S = 5.0
"""PostgreSQL shows a connection for a moment after it was closed, on a busy computer for longer."""


class Database:
    """One database, reached through transactions for reading or for writing.

    On SQLite one writer of this process writes at a time, and takes the file's write lock
    at the beginning, so that writers queue instead of failing; on PostgreSQL the use cases
    lock the machine's row before anything else (`app.storage.machines.RowLock`). Nothing is
    committed but by leaving `writing()` without an exception. Where a request is answered that
    stated a key, both look at the end whether the key may still do that.

    Parameters
    ----------
    url
        `sqlite:///FILE` or `postgresql://USER@HOST/DATABASE`.
    may_be_new
        Whether a SQLite file that is not there is made.

    Raises
    ------
    InvalidContent
        If the URL is none of a lasting database, or has options that there are none of.
    StorageUnavailable
        If a SQLite file is not there, or its folder.
    """

    def __init__(self, url: str, limits: Limits | None = None, *, may_be_new: bool = True) -> None:
        self._limits = limits or Limits()
        connections = _connections(_parse(url), self._limits, may_be_new=may_be_new)
        self._connections = connections
        self.engine = connections.engine
        self._file = connections.file if isinstance(connections, SqliteConnections) else None
        self._writer = None if self._file is None else Lock()
        self.sender = token_hex(4)
        """By which its own news are known."""
        self.log_mark = object()
        """Another one each time that the event log is known to have changed."""
        self.on_keys_changed: Callable[[], None] = lambda: None
        """Called after each commit of this process that changed keys or sessions, and before
        anybody is told of it."""

    @contextmanager
    def reading(self, limits: Limits | None = None) -> Iterator[Session]:
        """Open a session that changes nothing.

        Raises
        ------
        AccessRefused
            If the key of the request may not have it by now.
        """
        engine = self._limited(limits)
        with _as_storage_errors(), Session(engine, expire_on_commit=False) as session:
            yield session
            confirm_authorization(session, locked=False)

    @contextmanager
    def writing(self, limits: Limits | None = None) -> Iterator[Session]:
        """Open a session that is committed at the end, or rolled back whole.

        Raises
        ------
        StorageOvertaken
            If it was rolled back because of another transaction: the same again may succeed.
        AccessRefused
            If the key of the request may not do it by now.
        """
        writer = self._limited(limits).execution_options(thermap_writes=True)
        with self._turn(limits), _as_storage_errors((limits or self._limits).lock_s):
            with Session(writer, expire_on_commit=False) as session, session.begin():
                yield session
                # The order of locks, the same in every transaction that writes, so that no two wait
                # for each other:
                #     1  machines' rows                                   the use case (`RowLock`)
                #     2  whatever belongs to them                         the use case
                #     3  the key that asks                                here
                #     4  the numbering of the log, until the commit       `number_entries`
                # From 4 on all others who write into the log wait, so nothing else is waited for
                # after it. What others are to be told PostgreSQL keeps until the commit.
                confirm_authorization(session, locked=True)
                log_changes = number_entries(session)
                sent = send_pending(session, self.sender)
            if self._file is not None:
                self._file.check()  # else it is committed to a file that nobody will find
            if log_changes:
                self.note_log_change()
        if NewsKind.KEYS in sent:
            self.on_keys_changed()

    def note_log_change(self) -> None:
        """Take note that the event log has changed, here or elsewhere."""
        self.log_mark = object()

    @contextmanager
    def appending(self) -> Iterator[ImpatientConnection]:
        """Open a write transaction on PostgreSQL for what many want to have stored at a time.

        It is the driver's own.

        `appends_at_once` of a process at a time; it waits for a lock for a second at most.
        """
        connections = self._connections
        if isinstance(connections, SqliteConnections):
            raise TypeError("SQLite has no such connection: all writers share one lock")
        with _as_storage_errors(), connections.kept.writing() as connection:
            yield connection

    @property
    def appends_at_once(self) -> int:
        """How many transactions of readings that arrived together are worth while at a time."""
        return 1 if isinstance(self._connections, SqliteConnections) else self._connections.at_once

    def takes_writes(self) -> bool:
        """Whether something could be written now: on SQLite, others may hold the file's lock.

        False too where this process writes without a pause. Servers are always asked in vain:
        their locks are on tables and rows, and whoever waits for one is told.

        Raises
        ------
        StorageUnavailable
            If the file cannot be written at all.
        """
        if self._writer is None:
            return True
        writer = self.engine.execution_options(thermap_writes=True, thermap_limits=MOMENT)
        try:
            with self._turn(MOMENT), _as_storage_errors(), writer.connect() as connection:
                connection.begin().rollback()
        except StorageBusy:
            return False
        return True

    @contextmanager
    def migrating(self) -> Iterator[Connection]:
        """Open a write transaction in which tables may be made anew.

        SQLite changes a table by making another and dropping the old one, which with
        foreign keys on would take all rows that refer to it along. So they are off
        here, and checked before the commit. It takes as long as it takes.
        """
        writer = self._limited(UNLIMITED).execution_options(thermap_writes=True)
        with self._turn(UNLIMITED), _as_storage_errors(), writer.connect() as connection:
            on_sqlite = connection.dialect.name == "sqlite"
            driver: Any = connection.connection.dbapi_connection
            if on_sqlite:
                # Before the transaction, and on again after it: within one SQLite passes over it
                # without a word.
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
    def snapshot(self) -> Iterator[Connection]:
        """Read everything as it is at one moment, however long it takes."""
        with (
            _as_storage_errors(),
            self._limited(UNLIMITED).connect() as connection,
            connection.begin(),
        ):
            if not self.is_sqlite:
                # PostgreSQL's usual level shows each statement what is committed by then; a
                # transaction of SQLite has one moment for all.
                snapshot = "SET TRANSACTION ISOLATION LEVEL REPEATABLE READ, READ ONLY"
                connection.exec_driver_sql(snapshot)
            yield connection

    @contextmanager
    def alone(self) -> Iterator[Connection]:
        """Open a write transaction while no service runs: its memory would not follow.

        Raises
        ------
        Conflict
            If others have connections.
        """
        writer = self._limited(ALONE).execution_options(thermap_writes=True)
        self._expect_no_service()
        with self._turn(ALONE), _as_storage_errors(), writer.begin() as connection:
            if not self.is_sqlite:
                # A service that starts from now on waits before it changes a machine, whose row is
                # locked first.
                connection.exec_driver_sql("LOCK TABLE machine IN EXCLUSIVE MODE")
            yield connection

    def _expect_no_service(self) -> None:
        running = Conflict(f"a service is running on the database {self.name}: stop it first")
        if self.is_sqlite:
            with self.driver() as driver:
                driver.execute("PRAGMA busy_timeout = 0")
                try:
                    # Nobody leaves the log as long as others are connected.
                    driver.execute("PRAGMA journal_mode = DELETE")
                except sqlite3.OperationalError as error:
                    if "locked" not in str(error):
                        raise StorageUnavailable(f"the database is away: {error}") from error
                    raise running from error
            return
        until_s = monotonic() + LEAVES_WITHIN_S
        while self._are_others_connected():
            if monotonic() > until_s:
                raise running
            sleep(0.05)

    def _are_others_connected(self) -> bool:
        with self.reading() as session:
            return bool(session.execute(_OTHERS).scalar_one())

    @contextmanager
    def driver(self) -> Iterator[Any]:
        """Give the driver's own connection, outside of any transaction."""
        with _as_storage_errors():
            lent = self.engine.raw_connection()
        try:
            yield lent.driver_connection
        finally:
            lent.close()

    @property
    def is_sqlite(self) -> bool:
        """Whether it is a SQLite file."""
        return self._file is not None

    def _limited(self, limits: Limits | None) -> Engine:
        if limits is None:
            return self.engine
        return self.engine.execution_options(thermap_limits=limits)

    @contextmanager
    def _turn(self, limits: Limits | None) -> Iterator[None]:
        """Wait for this process's other writers, on SQLite; StorageBusy when it takes too long."""
        if self._writer is None:
            yield
            return
        patience_s = (limits or self._limits).lock_s
        if not self._writer.acquire(timeout=-1 if patience_s is None else patience_s):
            raise StorageBusy(f"the database is busy, try again: others wrote for {patience_s:g} s")
        try:
            yield
        finally:
            self._writer.release()

    @property
    def name(self) -> str:
        """The URL without its password."""
        return without_secrets(self.engine.url.render_as_string(hide_password=True))

    def duty(self, number: int) -> Duty | None:
        """Make what knows whether a duty is this process'; None on SQLite.

        Parameters
        ----------
        number
            Of the duty, the same in all processes.
        """
        if isinstance(self._connections, SqliteConnections):
            return None
        return self._connections.duty(number)

    def listener(self) -> Listener | None:
        """Make what hears the news of other processes; None on SQLite, where nobody tells any."""
        if isinstance(self._connections, SqliteConnections):
            return None
        return self._connections.listener(self.sender)

    def close(self) -> None:
        """Give up all connections; whoever waits for an answer of PostgreSQL is let go."""
        self._connections.close()


def _connections(
    url: URL, limits: Limits, *, may_be_new: bool
) -> PostgresqlConnections | SqliteConnections:
    if url.drivername in ("postgresql", "postgres", "postgresql+psycopg"):
        return _of_postgresql(url.set(drivername="postgresql+psycopg"), limits)
    if url.drivername not in ("sqlite", "sqlite+pysqlite"):
        raise InvalidContent.of_field(
            "database_url",
            f"expected sqlite:///FILE or postgresql://USER@HOST/DATABASE, got {url.drivername}://…",
        )
    if url.database in (None, "", ":memory:"):
        raise InvalidContent.of_field(
            "database_url", "expected a SQLite file, got none: what is stored has to last"
        )
    return SqliteConnections(url, limits, may_be_new=may_be_new)


def _of_postgresql(url: URL, limits: Limits) -> PostgresqlConnections:
    try:
        from app.storage.postgresql import DriverError, PostgresqlConnections
    except ImportError as error:
        raise InvalidContent.of_field(
            "database_url",
            "PostgreSQL needs its driver, which is not installed: "
            'pip install "thermap[postgresql]", or from a checkout pip install ".[postgresql]"',
        ) from error
    try:
        return PostgresqlConnections(url, limits)
    except (ArgumentError, ValueError, DriverError) as error:
        why = shown(str(error).strip())
        raise InvalidContent.of_field(
            "database_url", f"expected postgresql://USER@HOST/DATABASE?OPTION=VALUE, got: {why}"
        ) from None


def _parse(url: str) -> URL:
    try:
        return make_url(url)
    except (ArgumentError, ValueError):
        # Not what came: it may hold a password.
        raise InvalidContent.of_field(
            "database_url",
            "expected sqlite:///FILE or postgresql://USER@HOST/DATABASE, got text that is no URL",
        ) from None


_WAITED_IN_VAIN: Final = {"55P03", "57014"}
"""SQLSTATE of PostgreSQL where it is there, but others hold what is needed: lock not available,
query cancelled."""

_OVERTAKEN: Final = {"40P01", "40001"}
"""Of the one of several transactions that has to give way: deadlock, serialization failure."""


_NO_ROOM: Final = {"53100", "53400"}
"""Of PostgreSQL where there is none: disk full, configuration limit exceeded."""


def _has_no_room(cause: BaseException, reason: str) -> bool:
    """Whether something could not be stored because there is no place for it."""
    state: str | None = getattr(cause, "sqlstate", None)
    # SQLite cannot tell a disk that is full from one that fails where it reads its log's index.
    name: str = getattr(cause, "sqlite_errorname", "")
    return state in _NO_ROOM or name == "SQLITE_FULL" or "No space left on device" in reason


@contextmanager
def _as_storage_errors(lock_s: float | None = 0.0) -> Iterator[None]:
    """Turn the driver's many ways of being away into one.

    A SQLite file that is locked before locks were waited for as long as `lock_s` [s] did not
    let anybody wait, because whoever waited would have stood in the other's way.
    """
    began_at = monotonic()
    try:
        yield
    except (OperationalError, InterfaceError, DisconnectionError, PoolTimeout) as error:
        cause = getattr(error, "orig", None) or error
        lines = str(cause).strip().splitlines()
        reason = shown(lines[0]) if lines else type(error).__name__
        state = getattr(cause, "sqlstate", None)
        if _has_no_room(cause, reason):
            raise StorageFull(
                f"the disk of the database is full, nothing was stored: {reason}; make room, and "
                "send it again"
            ) from error
        is_locked = "locked" in reason
        at_once = lock_s is None or monotonic() - began_at < lock_s
        if state in _OVERTAKEN or (is_locked and at_once):
            raise StorageOvertaken(f"the database is busy, try again: {reason}") from error
        if is_locked or isinstance(cause, PoolTimeout) or state in _WAITED_IN_VAIN:
            raise StorageBusy(f"the database is busy, try again: {reason}") from error
        raise StorageUnavailable(f"the database is away: {reason}") from error
    except DatabaseError as error:
        # SQLite says so itself, not by a subclass, of a file that is no database or is damaged.
        if type(error) is not DatabaseError:
            raise
        raise StorageUnavailable(f"the database cannot be read: {error.orig}") from error
