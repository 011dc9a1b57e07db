"""thermap backup and restore: everything in one file, and back."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from app.cli.options import DatabaseOption, confirm
from app.cli.terminal import echo
from app.errors import counted, list_names
from app.events.event import acting
from app.settings import make_own_folder
from app.storage.backup import BackupContents, restore_backup, write_backup
from app.storage.restored_keys import RestoredKeys


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
    echo(f"backup {file}: {_summary(contents)}")


def restore(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="What `thermap backup` wrote.")],
    *,
    database_url: DatabaseOption,
    replace: Annotated[
        bool,
        typer.Option(
            "--replace",
            help="Delete what the database has, with all machines, and restore in its place.",
        ),
    ] = False,
    with_keys: Annotated[
        bool,
        typer.Option(
            "--with-keys",
            help="Bring back keys of the backup, too, that a database with keys of its own does "
            "not have: those that were revoked since.",
        ),
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask before that.")] = False,
) -> None:
    """Bring a backup into a database: whole, or not at all.

    Stop the service first. A backup of an older version is upgraded. A database that has keys, or
    had some, goes on with its own; another one takes those of the backup.

    Example: `thermap restore friday.thermap --database-url sqlite:///new.db`
    """
    if replace:
        confirm(
            "nothing was restored or deleted",
            "Delete everything in this database first?",
            yes=yes,
        )
    make_own_folder(database_url)
    before = acting.set("thermap restore")
    try:
        restored = restore_backup(database_url, file, replace=replace, with_keys=with_keys)
    finally:
        acting.reset(before)
    echo(f"restored {file}: {_summary(restored.contents)}")
    for words in _of_keys(restored.keys):
        echo(words)


def _of_keys(keys: RestoredKeys) -> Iterator[str]:
    """Say what became of keys, where there are any."""
    named_keys = (
        (keys.restored, "keys that came back with the backup"),
        (keys.remain, "keys that stay as they are in the database"),
        (keys.revoked, "keys revoked, as the backup does not have the machines they were for"),
        (
            keys.left_out,
            "keys of the backup that did not come back, since the database does not have them: "
            "revoked since, or made elsewhere (--with-keys brings them back, unless their name is "
            "another key's)",
        ),
        (keys.unreadable, "keys of the backup left out, with a role that this version lacks"),
    )
    for names, what in named_keys:
        if names:
            yield f"{what}: {list_names(names)}"


def _summary(contents: BackupContents) -> str:
    what = ", ".join(
        counted(number, name[:-1] if name != "analyses" else "analysis", name)
        for name, number in contents.counts.items()
    )
    return f"{what}; {contents.size_bytes / 1e6:.1f} MB"
