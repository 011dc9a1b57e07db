"""Databases to test with: migrated once a process, then copied."""

import os
import shutil
from uuid import uuid4

import psycopg
from sqlalchemy import make_url

from app.storage.database import Database
from app.storage.migrate import upgrade

POSTGRESQL = os.environ.get(
    "THERMAP_TEST_POSTGRESQL", "postgresql://postgres@127.0.0.1:5432/test"
)


class NotReachable(Exception):
    """There is no such server here."""


NO_WAIT = {"options": "-c synchronous_commit=off"}
"""PostgreSQL answers before its disk does: its durability is not what is tested here."""


class Databases:
    """Makes SQLite files in a folder and databases on the PostgreSQL server, and drops them."""

    def __init__(self, folder):
        self._folder = folder
        self._templates = {}
        self._made = set()
        self._server = None

    def empty(self, kind):
        """Make a database without tables; return its URL."""
        return self._make(kind, None)

    def migrated(self, kind):
        """Make a database with the newest tables; return its URL."""
        return self.copied(kind, _upgrade)

    def copied(self, kind, prepare):
        """Make a database as `prepare`, given the URL of an empty one, once left it."""
        if (kind, prepare) not in self._templates:
            url = self.empty(kind)
            prepare(url)
            self._templates[kind, prepare] = url
        return self._make(kind, self._templates[kind, prepare])

    def drop(self, url):
        """Remove a database, whoever is still connected to it."""
        self._made.discard(url)
        parsed = make_url(url)
        if parsed.get_backend_name() == "postgresql":
            self._execute(f'DROP DATABASE IF EXISTS "{parsed.database}" WITH (FORCE)')

    def close(self):
        for url in list(self._made):
            self.drop(url)
        if self._server is not None:
            self._server.close()

    def _make(self, kind, template):
        name = f"thermap_{uuid4().hex}"
        if kind == "sqlite":
            path = self._folder / f"{name}.db"
            if template is not None:
                shutil.copyfile(make_url(template).database, path)
            url = f"sqlite:///{path}"
        else:
            source = f' TEMPLATE "{make_url(template).database}"' if template else ""
            self._execute(f'CREATE DATABASE "{name}"{source}')
            url = make_url(POSTGRESQL).set(database=name).update_query_dict(NO_WAIT)
            url = url.render_as_string(hide_password=False)
        self._made.add(url)
        return url

    def _execute(self, statement):
        if self._server is None:
            try:
                self._server = psycopg.connect(POSTGRESQL, autocommit=True, connect_timeout=5)
            except psycopg.OperationalError as error:
                shown = make_url(POSTGRESQL).render_as_string()
                raise NotReachable(f"no PostgreSQL reachable at {shown}: {error}") from None
        self._server.execute(statement)


def _upgrade(url):
    database = Database(url)
    upgrade(database)
    database.close()
