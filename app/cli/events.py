"""thermap events: what happened, and by whose doing."""

from __future__ import annotations

from datetime import datetime
from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer
from rich.text import Text

from app.cli.answers import listing, or_nothing, when
from app.cli.asking import Shown, asks, calls
from app.cli.options import MachineOption, time_option

if TYPE_CHECKING:
    from rich.console import RenderableType

    from thermap.answers import Event, Events


@asks
def events(
    machine: MachineOption = None,
    since: Annotated[
        datetime | None, time_option("--from", "From this time on, with its zone.")
    ] = None,
    until: Annotated[datetime | None, time_option("--to", "Up to this time.")] = None,
    kind: Annotated[
        list[str] | None,
        typer.Option(
            "--kind",
            help="model, alarm, sensor, machine, readings, verification, analysis or key; once for "
            "each.",
        ),
    ] = None,
    limit: Annotated[int, typer.Option(min=1, max=10_000, help="At most so many.")] = 20,
) -> Shown:
    """List what happened, the newest first: changes, alarms, sensors lost and back.

    Example: `thermap events --machine vmc --kind alarm`
    """
    call = calls.events(machine, since=since, until=until, kinds=kind or (), limit=limit)
    return Shown(call, partial(_view, of_all=machine is None))


def _view(page: Events, *, of_all: bool) -> RenderableType:
    headings = ("time", *(["machine"] if of_all else []), "kind", "what")
    table = listing(*headings, right="L" * (len(headings) - 1))
    for event in page.events:
        where = [event.machine or ""] if of_all else []
        table.add_row(when(event.time), *where, event.kind, _words(event))
    return or_nothing(table, "nothing has happened")


def _words(event: Event) -> Text:
    """Say what happened, how often and until when, and who did it."""
    repeated = "" if event.count == 1 else f" ({event.count} times)"
    lasted = "" if event.until is None else f" (until {when(event.until)})"
    return Text.assemble(f"{event.text}{repeated}{lasted}", (f" · {event.who}", "dim"))
