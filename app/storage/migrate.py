"""Bringing a database to this version's tables, or refusing one that is newer."""

from __future__ import annotations

from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, text

import app
from app.errors import StorageTooNew
from app.storage.database import Database

UPGRADE_LOCK = 7_483_621
"""PostgreSQL advisory lock: two servers that start together upgrade one after the other."""


def upgrade(database: Database) -> str:
    """Upgrade an empty or older database in one transaction; return its revision.

    Raises
    ------
    StorageTooNew
        If the database has migrations that this version does not know.
    """
    scripts = ScriptDirectory.from_config(alembic_config())
    newest = scripts.get_current_head() or ""
    with database.migrating() as connection:
        if connection.dialect.name == "postgresql":
            connection.execute(text("SELECT pg_advisory_xact_lock(:k)"), {"k": UPGRADE_LOCK})
        found = current_revision(connection)
        known = {script.revision for script in scripts.walk_revisions()}
        if found is not None and found not in known:
            raise StorageTooNew(
                f"the database {database.name} was written by a newer thermap (its revision is "
                f"{found}, the newest known here is {newest}): install that version, "
                "or give another --database-url"
            )
        if found != newest:
            command.upgrade(alembic_config(connection), "head")
    return newest


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
