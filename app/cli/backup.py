"""thermap backup and restore: everything in one file, and back."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli.options import DatabaseOption, confirm
from app.errors import counted
from app.settings import make_own_folder
from app.storage.backup import BackupContents, restore_backup, write_backup


def backup(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A name that is free.")],
    *,
    database_url: DatabaseOption,
) -> None:
    """Write everything in the database to a file, while the service runs.

    The file is a SQLite database with everything as it was at one moment, also if the
    database is PostgreSQL. `thermap restore` checks it and brings it back, into either.

    Example: `thermap backup friday.thermap`
    """
    contents = write_backup(database_url, file)
    typer.echo(f"backup {file}: {_summary(contents)}")


def restore(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="What `thermap backup` wrote.")],
    *,
    database_url: DatabaseOption,
    replace: Annotated[
        bool,
        typer.Option(
            "--replace",
            envvar="THERMAP_REPLACE",
            help="Delete what the database has, with all machines, and restore in its place.",
        ),
    ] = False,
    yes: Annotated[
        bool, typer.Option("--yes", "-y", envvar="THERMAP_YES", help="Do not ask before that.")
    ] = False,
) -> None:
    """Bring a backup into a database: whole, or not at all.

    Stop the service first. A backup of an older version is upgraded.

    Example: `thermap restore friday.thermap --database-url sqlite:///new.db`
    """
    if replace:
        confirm(
            "nothing was restored or deleted",
            "Delete everything in this database first?",
            yes=yes,
        )
    make_own_folder(database_url)
    contents = restore_backup(database_url, file, replace=replace)
    typer.echo(f"restored {file}: {_summary(contents)}")


def _summary(contents: BackupContents) -> str:
    what = ", ".join(
        counted(number, name[:-1] if name != "analyses" else "analysis", name)
        for name, number in contents.counts.items()
    )
    return f"{what}; {contents.size_bytes / 1e6:.1f} MB"
