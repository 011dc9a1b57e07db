"""Connections to a SQLite file that is watched: a file that is gone keeps nothing."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from time import monotonic, sleep
from typing import Any, Final
from urllib.parse import quote

from sqlalchemy import URL, Connection, Engine, create_engine, event

from app.errors import StorageUnavailable
from app.storage.limits import Limits

AGAIN_S: Final = 0.01
"""After so long what SQLite refused at once is tried again [s]."""

_ANOTHER: Final = "name another file with --database-url sqlite:///FILE or its variable"


class SqliteFile:
    """One SQLite file, the same from the beginning to the end.

    A file that is deleted or replaced while it is open goes on taking what is written, and
    nobody ever finds it again. So the file of that name is compared with the one that was
    opened, at the beginning of each transaction and after each commit.

    Raises
    ------
    StorageUnavailable
        If the folder is not there, or the file cannot be made.
    """

    def __init__(self, path: Path, *, may_be_new: bool) -> None:
        self.path = path
        if may_be_new:
            _make(path)
        elif not path.is_file():
            raise StorageUnavailable(f"there is no database {path}")
        self._identity = self._found()

    def check(self) -> None:
        """Raise StorageUnavailable unless the file is still the one that was opened."""
        if self._found() != self._identity:
            raise StorageUnavailable(
                f"the database is away: {self.path} is another file than the one that was opened; "
                "start the service again to use it"
            )

    def _found(self) -> tuple[int, int]:
        """Identify the file that has the name now."""
        try:
            status = self.path.stat()
        except OSError as error:
            raise StorageUnavailable(
                f"the database is away: its file {self.path} was deleted or moved "
                f"({error.strerror})"
            ) from error
        return status.st_dev, status.st_ino


class SqliteConnections:
    """Makes the engine of a file."""

    def __init__(self, url: URL, limits: Limits, *, may_be_new: bool) -> None:
        self._limits = limits
        path = Path(str(url.database)).expanduser()
        self.file = SqliteFile(path, may_be_new=may_be_new)
        self.engine: Engine = create_engine(url.set(database=str(path)))
        event.listen(self.engine, "do_connect", self._connect)
        event.listen(self.engine, "connect", self._prepare)
        event.listen(self.engine, "begin", self._begin)

    def close(self) -> None:
        """Give up all connections."""
        self.engine.dispose()

    def _connect(
        self, _dialect: Any, _record: Any, _arguments: Any, named: Any
    ) -> sqlite3.Connection:
        # rw: a file that is gone must not come back empty.
        uri = f"file:{quote(str(self.file.path.absolute()))}?mode=rw"
        opened: sqlite3.Connection = sqlite3.connect(
            uri, uri=True, timeout=_patience_s(self._limits), **named
        )
        return opened

    def _prepare(self, connection: sqlite3.Connection, _record: Any) -> None:
        """Make SQLite keep what was answered: log, foreign keys, and a sync at each commit."""
        self.file.check()
        connection.isolation_level = None  # we say BEGIN ourselves, see _begin
        _log_ahead(connection, _patience_s(self._limits))
        # A file that logs ahead, as NORMAL has it, syncs now and then: the last commits could be
        # lost with the power. FULL syncs at each.
        for pragma in (
            "foreign_keys = ON",
            "synchronous = FULL",
            "journal_size_limit = 67108864",
        ):
            connection.execute(f"PRAGMA {pragma}")

    def _begin(self, connection: Connection) -> None:
        self.file.check()
        options = connection.get_execution_options()
        limits: Limits = options.get("thermap_limits", self._limits)
        driver: Any = connection.connection.driver_connection
        # Each time: a connection of the pool has what its last transaction was patient for.
        driver.execute(f"PRAGMA busy_timeout = {round(1000 * _patience_s(limits))}")
        writes = options.get("thermap_writes", False)
        # A transaction that has read is refused at once, however long it would wait, when it wants
        # to write and another has written in between: what it has read is old. With the write lock
        # from the beginning it waits for its turn.
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


def _patience_s(limits: Limits) -> float:
    return 3600.0 if limits.lock_s is None else limits.lock_s


def _log_ahead(connection: sqlite3.Connection, patience_s: float) -> None:
    """Have a file log ahead of what it writes, as the first of its connections says to it.

    SQLite refuses that at once while others look at the file, however long it may wait for locks.
    """
    until = monotonic() + patience_s
    while True:
        try:
            connection.execute("PRAGMA journal_mode = WAL")
            return
        except sqlite3.OperationalError as error:
            if "locked" not in str(error) or monotonic() > until:
                raise
        sleep(AGAIN_S)


def _make(path: Path) -> None:
    """Make the file unless it is there, but no folder: its name may be misspelt."""
    try:
        if path.parent.is_dir():
            if not path.exists():
                path.touch()
            return
    except OSError as error:
        raise StorageUnavailable(
            f"the database {path} cannot be made ({error.strerror}); {_ANOTHER}"
        ) from error
    raise StorageUnavailable(
        f"there is no folder {path.parent.absolute()} for the database {path.name}; make the "
        f"folder, or {_ANOTHER}"
    )
