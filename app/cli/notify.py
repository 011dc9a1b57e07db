"""thermap notify: who is told of alarms, how that went, and a test message."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.text import Text

from app.cli.answers import listing, or_nothing, when
from app.cli.asking import Shown, ThermapClient, asks, calls
from app.cli.terminal import complain, echo
from app.errors import list_names

if TYPE_CHECKING:
    from rich.console import RenderableType

    from thermap.answers import Receiver, Receivers

PATIENCE_S: Final = 60.0
"""How long a test message may take on its way [s]."""

POLL_S: Final = 0.5

notify = typer.Typer(invoke_without_command=True, add_completion=False, rich_markup_mode="markdown")


@notify.callback()
@asks
def who_is_told(ctx: typer.Context) -> Shown | None:
    """Show who is told of alarms and how that went, or send a test message.

    Example: `thermap notify`, `thermap notify test maintenance`
    """
    if ctx.invoked_subcommand is not None:
        return None
    return Shown(calls.receivers(), receivers_view)


@notify.command("test")
@asks
def send_test(
    thermap: ThermapClient,
    name: Annotated[str | None, typer.Argument(metavar="NAME", show_default="all of them")] = None,
) -> None:
    """Send a test message, and wait for whether it arrived; exit code 1 where it did not.

    Example: `thermap notify test maintenance`
    """
    names = [r.name for r in thermap.receivers().receivers] if name is None else [name]
    if not names:
        complain("there is no receiver: [[notify]] in the file of `thermap serve --config`")
        raise typer.Exit(1)
    arrived = [_arrives(thermap, receiver_name) for receiver_name in names]
    if not all(arrived):
        raise typer.Exit(1)


def _arrives(thermap: ThermapClient, name: str) -> bool:
    """Ask for a test message, and say what became of it."""
    asked_at = thermap.test_receiver(name).test_asked_at
    until_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < until_s:
        receiver = {item.name: item for item in thermap.receivers().receivers}.get(name)
        if receiver and receiver.tested_at and asked_at and receiver.tested_at >= asked_at:
            if receiver.test_failure:
                complain(f"{name}: not sent: {receiver.test_failure}")
            else:
                echo(f"{name}: sent by {receiver.service}")
            return not receiver.test_failure
        time.sleep(POLL_S)
    complain(f"{name}: no service has sent it within {PATIENCE_S:g} s")
    return False


def receivers_view(receivers: Receivers) -> RenderableType:
    """Lay out all receivers, those that cannot be told first."""
    table = listing("name", "by", "machines", "last message (UTC)", "", "waiting", "trouble")
    for receiver in sorted(receivers.receivers, key=lambda item: not item.trouble):
        table.add_row(
            receiver.name,
            receiver.service,
            list_names(receiver.machines, limit=3) if receiver.machines else "all",
            when(receiver.sent_at),
            receiver.sent,
            list_names(receiver.waiting, limit=3) if receiver.waiting else "",
            Text(_trouble(receiver), style="bold red"),
        )
    return or_nothing(
        table, "nobody is told of alarms: [[notify]] in the file of `thermap serve --config`"
    )


def _trouble(receiver: Receiver) -> str:
    return receiver.trouble and f"{receiver.trouble}, since {when(receiver.trouble_since)}"
