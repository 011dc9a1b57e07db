"""Bringing a database to this version's tables, or refusing one of another version."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import NamedTuple

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, text

import app
from app.errors import UnknownRevision
from app.storage.database import Database
from app.storage.job_queue import prepare_queue

LAST_CHAIN = "e1272f7b"
"""Knows the tables of all states from 0.1.0 on, and ends at the first revision known here."""

UPGRADE_LOCK = 7_483_621
"""PostgreSQL advisory lock: two servers that start together upgrade one after the other."""


class Upgraded(NamedTuple):
    """A database's revisions before, None of an empty one, and now."""

    before: str | None
    now: str

    @property
    def was_empty(self) -> bool:
        """Whether there was nothing before."""
        return self.before is None


def upgrade(database: Database) -> Upgraded:
    """Upgrade an empty or older database in one transaction; return its revisions.

    Raises
    ------
    UnknownRevision
        If another version wrote the database.
    """
    newest = newest_revision()
    with database.migrating() as connection:
        if connection.dialect.name == "postgresql":
            connection.execute(text("SELECT pg_advisory_xact_lock(:k)"), {"k": UPGRADE_LOCK})
        revision = checked_revision(connection, f"the database {database.name}")
        if revision != newest:
            command.upgrade(alembic_config(connection), "head")
        if connection.dialect.name == "postgresql":
            prepare_queue(connection)
    return Upgraded(revision, newest)


def newest_revision() -> str:
    """Name the newest revision that this version knows."""
    return _known_revisions()[0]


@cache
def _known_revisions() -> tuple[str, ...]:
    """Name the revisions that this version knows, the newest first; Alembic compiles each anew."""
    scripts = ScriptDirectory.from_config(alembic_config())
    return tuple(script.revision for script in scripts.walk_revisions())


def checked_revision(connection: Connection, what: str) -> str | None:
    """Read a database's revision, None where it is empty.

    Raises
    ------
    UnknownRevision
        If this version does not know it.
    """
    revision = current_revision(connection)
    if revision is not None and revision not in _known_revisions():
        raise UnknownRevision(
            f"{what} was written by another thermap (its revision is {revision}, the newest known "
            f"here is {newest_revision()}): if it was a newer one, install that version; if it was "
            f"one before the first release, open or restore it once with commit {LAST_CHAIN}, "
            "which brings it up to date"
        )
    return revision


def current_revision(connection: Connection) -> str | None:
    """Read which migration a database is at, None where it is empty."""
    return MigrationContext.configure(connection).get_current_revision()


def alembic_config(connection: Connection | None = None) -> Config:
    """Point Alembic at the migrations that travel with the package."""
    config = Config()
    folder = str(_migrations_folder()).replace("%", "%%")  # Alembic reads % as a placeholder's
    config.set_main_option("script_location", folder)
    config.set_main_option("path_separator", "os")
    config.attributes["connection"] = connection
    return config


def _migrations_folder() -> Path:
    """In an installed package beside the code, in a checkout beside the package."""
    package = Path(app.__file__).parent
    installed = package / "migrations"
    return installed if installed.is_dir() else package.parent / "migrations"
