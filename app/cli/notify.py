"""thermap notify: who is told of alarms, how that went, and a test message."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.text import Text

from app.cli.answers import listing, or_nothing, show, when
from app.cli.options import JsonOption, UrlOption, connect
from app.cli.terminal import complain, echo
from app.errors import list_names
from thermap import DEFAULT_URL

if TYPE_CHECKING:
    from rich.console import RenderableType

    from thermap import ThermapClient
    from thermap.answers import Receiver, Receivers

PATIENCE_S: Final = 60.0
"""How long a test message may take on its way [s]."""

POLL_S: Final = 0.5

notify = typer.Typer(invoke_without_command=True, add_completion=False, rich_markup_mode="markdown")


@notify.callback()
def who_is_told(ctx: typer.Context, json: JsonOption = False, url: UrlOption = DEFAULT_URL) -> None:
    """Show who is told of alarms and how that went, or send a test message.

    Example: `thermap notify`, `thermap notify test maintenance`
    """
    if ctx.invoked_subcommand is not None:
        return
    from thermap import calls

    with connect(url) as thermap:
        show(thermap, calls.receivers(), receivers_view, json=json)


@notify.command("test")
def send_test(
    name: Annotated[str | None, typer.Argument(metavar="NAME", show_default="all of them")] = None,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """Send a test message, and wait for whether it arrived; exit code 1 where it did not.

    Example: `thermap notify test maintenance`
    """
    with connect(url) as thermap:
        names = [one.name for one in thermap.receivers().receivers] if name is None else [name]
        if not names:
            complain("there is no receiver: [[notify]] in the file of `thermap serve --config`")
            raise typer.Exit(1)
        failed = [asked for asked in names if not _arrives(thermap, asked)]
    if failed:
        raise typer.Exit(1)


def _arrives(thermap: ThermapClient, name: str) -> bool:
    """Ask for a test message, and say what became of it."""
    asked_at = thermap.test_receiver(name).test_asked_at
    until_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < until_s:
        found = {one.name: one for one in thermap.receivers().receivers}.get(name)
        if found and found.tested_at and asked_at and found.tested_at >= asked_at:
            if found.test_failure:
                complain(f"{name}: not sent: {found.test_failure}")
            else:
                echo(f"{name}: sent by {found.service}")
            return not found.test_failure
        time.sleep(POLL_S)
    complain(f"{name}: no service has sent it within {PATIENCE_S:g} s")
    return False


def receivers_view(found: Receivers) -> RenderableType:
    """Lay out all receivers, those that cannot be told first."""
    table = listing("name", "by", "machines", "last message (UTC)", "", "waiting", "trouble")
    for one in sorted(found.receivers, key=lambda one: not one.trouble):
        table.add_row(
            one.name,
            one.service,
            list_names(one.machines, limit=3) if one.machines else "all",
            when(one.sent_at),
            one.sent,
            list_names(one.waiting, limit=3) if one.waiting else "",
            Text(_trouble(one), style="bold red"),
        )
    return or_nothing(
        table, "nobody is told of alarms: [[notify]] in the file of `thermap serve --config`"
    )


def _trouble(one: Receiver) -> str:
    return one.trouble and f"{one.trouble}, since {when(one.trouble_since)}"
