"""Bringing a database to this version's tables, or refusing one that is newer."""

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
from app.errors import StorageTooNew
from app.storage.database import Database
from app.storage.job_queue import prepare_queue

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
    StorageTooNew
        If the database has migrations that this version does not know.
    """
    newest = newest_revision()
    with database.migrating() as connection:
        if connection.dialect.name == "postgresql":
            connection.execute(text("SELECT pg_advisory_xact_lock(:k)"), {"k": UPGRADE_LOCK})
        revision = check_not_newer(connection, f"the database {database.name}")
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


def check_not_newer(connection: Connection, what: str) -> str | None:
    """Read a database's revision, None where it is empty.

    Raises
    ------
    StorageTooNew
        If this version does not know it.
    """
    revision = current_revision(connection)
    if revision is not None and revision not in _known_revisions():
        raise StorageTooNew(
            f"{what} was written by a newer thermap (its revision is {revision}, the newest known "
            f"here is {newest_revision()}): install that version, or give another one"
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
