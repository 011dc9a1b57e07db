"""Databases to test with: prepared once a process, then copied or used again.

A PostgreSQL server takes tenths of a second to create and to drop a database, because
it waits for the disk. So one that is done with is emptied, filled again as it was
prepared, and handed to the next test.
"""

import os
import shutil
import sqlite3
from collections import defaultdict
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from time import time
from uuid import uuid4

import psycopg
import pytest
from sqlalchemy import Engine, event, make_url

from app.storage.database import Database
from app.storage.job_queue import SCHEMA
from app.storage.migrate import upgrade
from app.storage.tables import Base

KINDS = ("sqlite", "postgresql")

POSTGRESQL = os.environ.get("THERMAP_TEST_POSTGRESQL", "postgresql://postgres@127.0.0.1:5432/test")

PREFIX = "thermap_test_"

NO_WAIT = {"options": "-c synchronous_commit=off"}
"""PostgreSQL answers before its disk does: its durability is not what is tested here."""


WAITS_FOR_THE_DISK = False
"""Whether SQLite, in this process, waits as the service has it do: for the same reason."""


@event.listens_for(Engine, "begin")
def _let_sqlite_not_wait(connection):
    """The service's own listener of a new connection comes after ours, so before each BEGIN."""
    opened = connection.connection.driver_connection
    if isinstance(opened, sqlite3.Connection) and not WAITS_FOR_THE_DISK:
        opened.execute("PRAGMA synchronous = OFF")


TABLES = [table.name for table in Base.metadata.sorted_tables]
NUMBERED = [t.name for t in Base.metadata.sorted_tables if t.autoincrement_column is not None]


class NotReachable(Exception):
    """There is no such server here."""


def reachable(make, kind):
    """Make a database, or skip the test where its server is not there."""
    try:
        return make(kind)
    except NotReachable as away:
        if os.environ.get("THERMAP_REQUIRE_SERVICES"):
            pytest.fail(str(away))
        return pytest.skip(str(away))


class Databases:
    """Makes SQLite files in a folder and databases on the PostgreSQL server, and drops them."""

    def __init__(self, folder):
        self._folder = folder
        self._files = {}
        self._idle = defaultdict(list)
        self._lent = {}
        self._server = None

    def empty(self, kind):
        """Make a database without tables; return its URL."""
        name = f"{PREFIX}{int(time()):x}_{uuid4().hex[:16]}"
        if kind == "sqlite":
            return f"sqlite:///{self._folder / name}.db"
        self._execute(f'CREATE DATABASE "{name}"')
        url = make_url(POSTGRESQL).set(database=name).update_query_dict(NO_WAIT)
        return url.render_as_string(hide_password=False)

    def migrated(self, kind):
        """Make a database with the newest tables; return its URL."""
        return self.prepared(kind, migrate)

    def prepared(self, kind, prepare):
        """Make a database as `prepare`, given the URL of an empty one, leaves it."""
        if kind == "sqlite":
            return self._copied_file(prepare)
        idle = self._idle[prepare]
        database = idle.pop() if idle else Refillable(self.empty(kind), prepare)
        self._lent[database.url] = (database, idle)
        return database.url

    def give_back(self, url):
        """Be done with a database, whoever is still connected to it."""
        if url in self._lent:
            database, idle = self._lent.pop(url)
            database.refill()
            idle.append(database)
        elif url.startswith("sqlite"):
            for file in Path(make_url(url).database).parent.glob(f"{Path(url).name}*"):
                file.unlink()
        else:
            self._execute(f'DROP DATABASE "{make_url(url).database}" WITH (FORCE)')

    def close(self):
        """Drop every database that is kept."""
        for database in [d for idle in self._idle.values() for d in idle]:
            database.close()
            self.give_back(database.url)
        if self._server is not None:
            self._server.close()

    def _copied_file(self, prepare):
        if prepare not in self._files:
            self._files[prepare] = self.empty("sqlite")
            prepare(self._files[prepare])
        url = self.empty("sqlite")
        shutil.copyfile(make_url(self._files[prepare]).database, make_url(url).database)
        return url

    def _execute(self, statement):
        if self._server is None:
            try:
                self._server = psycopg.connect(POSTGRESQL, autocommit=True, connect_timeout=60)
            except psycopg.OperationalError as error:
                shown = make_url(POSTGRESQL).render_as_string()
                raise NotReachable(f"no PostgreSQL reachable at {shown}: {error}") from None
            self._sweep()
        self._server.execute(statement)

    def _sweep(self):
        """Drop what runs that were killed have left: nobody's, and more than an hour old."""
        names = "SELECT datname FROM pg_database WHERE datname LIKE %s"
        for (name,) in self._server.execute(names, [f"{PREFIX}%"]).fetchall():
            made = int(name.removeprefix(PREFIX).split("_")[0], 16)
            if made < time() - 3600:
                with suppress(psycopg.Error):
                    self._server.execute(f'DROP DATABASE IF EXISTS "{name}"')


class Refillable:
    """A PostgreSQL database that can be brought back to how it was prepared."""

    def __init__(self, url, prepare):
        prepare(url)
        self.url = url
        plain = make_url(url).set(query={}).render_as_string(hide_password=False)
        self._connection = psycopg.connect(plain, autocommit=True, options=NO_WAIT["options"])
        copies = "".join(f"CREATE TABLE kept.{t} AS TABLE public.{t};" for t in TABLES)
        self._connection.execute(f"CREATE SCHEMA kept; {copies}")

    def refill(self):
        """Throw everybody out, and everything that was stored since."""
        clear = "".join(f"DELETE FROM public.{t};" for t in reversed(TABLES))
        fill = "".join(f"INSERT INTO public.{t} TABLE kept.{t};" for t in TABLES)
        renumber = "".join(
            f"SELECT setval('{t}_id_seq', (SELECT coalesce(max(id), 0) + 1 FROM {t}), false);"
            for t in NUMBERED
        )
        self._connection.execute(
            "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
            "WHERE datname = current_database() AND pid <> pg_backend_pid();"
        )
        queue = (
            f"SET LOCAL search_path = {SCHEMA}, public;"  # what is deleted there looks for its own
            "DELETE FROM procrastinate_jobs; DELETE FROM procrastinate_workers;"
        )
        self._connection.execute(f"BEGIN; {clear} {fill} {renumber} {queue} COMMIT;")

    def close(self):
        self._connection.close()


def migrate(url):
    """Bring an empty database to the newest tables."""
    database = Database(url)
    upgrade(database)
    database.close()


@contextmanager
def locked(url, begin="EXCLUSIVE"):
    """Hold what every question about machines needs: their table, or SQLite's lock.

    That one is EXCLUSIVE, or IMMEDIATE to let others read.
    """
    parsed = make_url(url)
    if parsed.get_backend_name() == "sqlite":
        with closing(sqlite3.connect(parsed.database, isolation_level=None)) as other:
            other.execute(f"BEGIN {begin}")
            yield
            other.execute("ROLLBACK")
        return
    plain = parsed.set(drivername="postgresql", query={}).render_as_string(hide_password=False)
    with psycopg.connect(plain) as other:
        other.execute("LOCK TABLE machine IN ACCESS EXCLUSIVE MODE")
        yield
        other.rollback()
