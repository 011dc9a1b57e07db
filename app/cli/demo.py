"""thermap demo: the service with an example machine that lives."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack
from datetime import UTC, datetime
from typing import Annotated, Any, Final

import typer

from app.cli.console import console
from app.cli.demo_machine import reading_at, set_up
from app.cli.demo_view import argument_view, current_view, short_line
from app.cli.demo_week import loading_week, show_later, week_hint
from app.cli.listening import (
    database_of,
    exiting_on_signals,
    listening,
    make_service,
    new_database_note,
    serving,
    url_of,
)
from app.cli.options import UrlOption, connect, is_typed
from app.cli.settings_options import checked_settings, with_settings
from app.cli.terminal import echo
from app.settings import sqlite_url
from app.simulation.example.remaining_error import remaining_errors
from thermap import ThermapClient
from thermap.answers import CurrentCompensationAnswer

READING_EVERY_S: Final = 1.0
LINE_EVERY_S: Final = 10.0


@with_settings("host", "port", "allowed_hosts", "insecure")
def demo(
    ctx: typer.Context,
    *,
    settings: dict[str, Any],
    database_url: Annotated[
        str,
        typer.Option(
            envvar="THERMAP_DEMO_DATABASE_URL",
            metavar="URL",
            default_factory=lambda: sqlite_url("thermap-demo.db"),
            show_default="thermap-demo.db in your folder for data",
            help="A database of the demo's own.",
        ),
    ],
    no_serve: Annotated[
        bool,
        typer.Option(
            "--no-serve",
            envvar="THERMAP_DEMO_NO_SERVE",
            help="Use the service that is at --url already.",
        ),
    ] = False,
    later: Annotated[
        bool,
        typer.Option(
            "--later",
            envvar="THERMAP_DEMO_LATER",
            help="Send the demo that runs the two days after its week, and show what the model "
            "leaves of them before and after an effect was adopted.",
        ),
    ] = False,
    service_url: UrlOption = "",
) -> None:
    """Run the service with a simulated machine that warms up and cools down.

    It stores Runs 1, 3 and 6 of the example, shows what compensation leaves of the
    other runs (µm, µm/m, µrad), then sends a reading every second (°C) and shows the
    compensation table, which the dashboard shows as it changes. Everything about the machine
    is simulated.

    A second machine, `mcfv5050-week`, has a week of readings, verifications, and an effect that
    its model lacks: `thermap analyse mcfv5050-week --adopt` finds it.

    Example: `thermap demo --port 8001`
    """
    if is_typed(ctx, "service_url") and not (later or no_serve):
        raise typer.BadParameter(
            "the demo starts a service of its own, at --host and --port; another one's URL is for "
            "--later and --no-serve",
            param_hint="--url",
        )
    there = _where(ctx, service_url, settings["host"], settings["port"])
    if later:
        show_later(there)
        return
    with exiting_on_signals(), ExitStack() as running:
        if no_serve:
            url = there
        else:
            chosen = checked_settings(
                {**settings, "database_url": database_url, "log_level": "warning"}
            )
            if chosen.asks_for_keys:
                raise typer.BadParameter(
                    f"other computers reach {chosen.host}, and the demo knows no keys: everybody "
                    "may change it. Where that is meant, add --insecure",
                    param_hint="--host",
                )
            opened = running.enter_context(listening(chosen.host, chosen.port, "demo"))
            url = url_of(opened)
            service = make_service(chosen)
            running.enter_context(serving(service, opened, chosen.log_level))
            echo(f"thermap demo: dashboard {url}, to read and try: {url}/docs")
            echo(f"database {database_of(service)}{new_database_note(service)}\n")
        thermap = running.enter_context(connect(url))
        machine = set_up(thermap)
        terminal = console()
        terminal.print(argument_view(remaining_errors()))
        terminal.print()
        # A command that is to be copied stays in one line, however narrow the terminal.
        terminal.print(week_hint(thermap.base_url), crop=False)
        terminal.print()
        tables = _live_tables(thermap, machine)
        first = next(tables)
        # The first table stands before anything else is asked of the service.
        running.enter_context(loading_week(url))
        terminal.print(current_view(first, terminal.width))
        last_line_s = time.monotonic()
        for table in tables:
            if time.monotonic() - last_line_s >= LINE_EVERY_S:
                last_line_s += LINE_EVERY_S
                echo(short_line(table))


def _where(ctx: typer.Context, url: str, host: str, port: int) -> str:
    """Find the service that runs already: what was typed goes before the environment."""
    is_typed_otherwise = is_typed(ctx, "host") or is_typed(ctx, "port")
    if url and (is_typed(ctx, "service_url") or not is_typed_otherwise):
        return url
    return f"http://{f'[{host}]' if ':' in host else host}:{port}"


def _live_tables(thermap: ThermapClient, machine: str) -> Iterator[CurrentCompensationAnswer]:
    """Send a reading every whole second and give the table that follows from it."""
    while True:
        thermap.store_readings(machine, reading_at(datetime.now(UTC)))
        tagged = thermap.current_table(machine)
        assert tagged is not None  # without an ETag there is always a table
        yield tagged.table
        time.sleep(READING_EVERY_S - time.time() % READING_EVERY_S)
