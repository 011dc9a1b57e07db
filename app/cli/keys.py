"""thermap keys: who may ask a service that other computers reach.

They work on the database itself: who made no key yet, or lost the last one, can still make one.
"""

from __future__ import annotations

import json as json_text
from contextlib import closing
from dataclasses import asdict
from typing import Annotated

import typer

from app.access.keys import AccessKey, Role
from app.cli.answers import listing, show_view, when
from app.cli.options import DatabaseOption, JsonOption, YesOption, command_group, confirm
from app.cli.terminal import echo, write_document
from app.errors import list_names
from app.events.event import acting
from app.services.access_keys import (
    create_key,
    revoke_key,
    show_keys,
    show_unreadable_keys,
)
from app.settings import make_own_folder
from app.storage.database import Database
from app.storage.migrate import upgrade

keys = command_group()

NameArgument = Annotated[
    str, typer.Argument(metavar="NAME", help="Whose it is: a person, a computer, a sensor.")
]


@keys.callback()
def _describe(context: typer.Context) -> None:
    """Make, list and revoke the keys that a service asks for."""
    before = acting.set("thermap keys")
    context.call_on_close(lambda: acting.reset(before))


@keys.command("create")
def create(
    name: NameArgument,
    *,
    role: Annotated[
        Role,
        typer.Option(
            help="sensor: sends readings. viewer: reads and computes. metrologist: both, and maps, "
            "verifications, adoption. admin: machines and keys too."
        ),
    ],
    machine: Annotated[
        list[str] | None,
        typer.Option(
            "--machine",
            "-m",
            envvar="THERMAP_KEY_MACHINES",
            metavar="MACHINE",
            help="A machine that it is for, once for each; without it all.",
        ),
    ] = None,
    database_url: DatabaseOption,
) -> None:
    """Make a key and write it once: it is stored nowhere.

    Example: `thermap keys create line-3 --role sensor --machine vmc`
    """
    make_own_folder(database_url)
    with closing(Database(database_url)) as database:
        upgrade(database)
        created = create_key(database, name, role, machine or None)
    key = created.key
    echo(created.secret)
    echo(
        f"key {key.name}, {key.role}, for {_machines(key)}. It is shown this once. Clients "
        "state it as `Authorization: Bearer KEY`, or read it from THERMAP_KEY",
        err=True,
    )


@keys.command("list")
def list_keys(*, database_url: DatabaseOption, json: JsonOption = False) -> None:
    """List keys: what each may do, and when it was used last."""
    with closing(Database(database_url, may_be_new=False)) as database:
        stored_keys = show_keys(database)
        unreadable = show_unreadable_keys(database)
    if unreadable:
        echo(
            "no keys here, as this version does not know their role or machines: "
            f"{list_names(unreadable)}; `thermap keys revoke` deletes them",
            err=True,
        )
    if json:
        write_document(json_text.dumps([asdict(key) for key in stored_keys], default=str) + "\n")
        return
    table = listing("key", "role", "machines", "made", "last used")
    for key in stored_keys:
        used = "never" if key.last_used_at is None else when(key.last_used_at)
        table.add_row(key.name, str(key.role), _machines(key), when(key.created_at), used)
    show_view(table)


@keys.command("revoke")
def revoke(name: NameArgument, *, database_url: DatabaseOption, yes: YesOption = False) -> None:
    """Revoke a key; a running service refuses it within a second.

    Streams that were opened with it end within a heartbeat, browsers ask for another.
    """
    with closing(Database(database_url, may_be_new=False)) as database:
        present = show_keys(database)
        admins = [key.name for key in present if key.role is Role.ADMIN]
        is_last = admins == [name]
        named = f"key {name!r}" + (", the last one of an admin," if is_last else "")
        if any(key.name == name for key in present):  # of another `revoke_key` says so
            confirm(
                f"{named} was not revoked",
                f"Revoke the {named.rstrip(',')}? Who uses it is refused from then on.",
                yes=yes,
            )
        revoke_key(database, name, last_admin=is_last)
    echo(f"key {name} is revoked")
    if is_last:
        echo(
            "no key of an admin is left; `thermap keys create NAME --role admin` makes one",
            err=True,
        )


def _machines(key: AccessKey) -> str:
    return "all machines" if key.machines is None else ", ".join(key.machines)
