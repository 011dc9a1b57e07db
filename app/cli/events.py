"""thermap events: what happened, and by whose doing."""

from __future__ import annotations

from datetime import datetime
from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer
from rich.text import Text

from app.cli.answers import listing, or_nothing, show, when
from app.cli.options import JsonOption, MachineOption, UrlOption, connect, time_option
from thermap import DEFAULT_URL

if TYPE_CHECKING:
    from rich.console import RenderableType

    from thermap.answers import Event, Events


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
    *,
    json: JsonOption = False,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """List what happened, the newest first: changes, alarms, sensors lost and back.

    Example: `thermap events --machine vmc --kind alarm`
    """
    from thermap import calls

    with connect(url) as thermap:
        ask = calls.all_events if machine is None else partial(calls.events, machine)
        call = ask(since=since, until=until, kinds=kind or (), limit=limit)
        show(thermap, call, partial(_view, of_all=machine is None), json=json)


def _view(page: Events, *, of_all: bool) -> RenderableType:
    table = listing("time", *(["machine"] if of_all else []), "kind", "what")
    for column in table.columns[:-1]:
        column.no_wrap = True
    for event in page.events:
        where = [event.machine or ""] if of_all else []
        table.add_row(when(event.time), *where, event.kind, _words(event))
    return or_nothing(table, "nothing has happened")


def _words(event: Event) -> Text:
    """Say what happened, how often and until when, and who did it."""
    repeated = "" if event.count == 1 else f" ({event.count} times)"
    lasted = "" if event.until is None else f" (until {when(event.until)})"
    return Text.assemble(f"{event.text}{repeated}{lasted}", (f" · {event.who}", "dim"))
