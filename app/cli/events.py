"""thermap events: what happened, and by whose doing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.answers import listing, show, when
from app.cli.options import JsonOption, MachineOption, UrlOption, connect, read_time
from thermap import DEFAULT_URL

if TYPE_CHECKING:
    from rich.console import RenderableType

    from thermap.answers import Events


def events(
    machine: MachineOption = None,
    since: Annotated[
        str | None,
        typer.Option(
            "--from",
            envvar="THERMAP_FROM",
            metavar="TIME",
            help="From this time on, with its zone.",
        ),
    ] = None,
    until: Annotated[
        str | None,
        typer.Option("--to", envvar="THERMAP_TO", metavar="TIME", help="Up to this time."),
    ] = None,
    kind: Annotated[
        list[str] | None,
        typer.Option(
            "--kind",
            envvar="THERMAP_KIND",
            help="model, alarm, sensor, machine, readings, verification, analysis or key; once for "
            "each.",
        ),
    ] = None,
    limit: Annotated[
        int, typer.Option(envvar="THERMAP_LIMIT", min=1, max=10_000, help="At most so many.")
    ] = 20,
    *,
    json: JsonOption = False,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """List what happened, the newest first: changes, alarms, sensors lost and back.

    Example: `thermap events --machine vmc --kind alarm`
    """
    from thermap import calls

    first = None if since is None else read_time(since, "--from")
    last = None if until is None else read_time(until, "--to")
    with connect(url) as thermap:
        asked = (first, last, kind or (), None, limit)
        call = calls.all_events(*asked) if machine is None else calls.events(machine, *asked)
        show(thermap, call, _view, json=json)


def _view(found: Events) -> RenderableType:
    table = listing("time", "until", "machine", "kind", "what", "who")
    for event in found.events:
        until = "" if event.until is None else when(event.until)
        text = event.text if event.count == 1 else f"{event.text} ({event.count} times)"
        table.add_row(when(event.time), until, event.machine or "", event.kind, text, event.who)
    return table
