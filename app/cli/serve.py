"""thermap serve: the service, one process or several that share its socket."""

from __future__ import annotations

from typing import Annotated, Any, Final

import typer

import app as package
from app.cli.listening import (
    database_of,
    exiting_on_signals,
    listening,
    make_service,
    new_database_note,
    server_for,
    url_of,
)
from app.cli.logs import LogFormat, write_log_as
from app.cli.settings_options import checked_settings, with_settings
from app.cli.terminal import echo
from app.cli.workers import Workers
from app.services.access_keys import create_first_key
from app.settings import Settings, is_postgresql, is_this_computer

_INTERNAL: Final = ("lock_limit_s", "waiting_limit_s", "worker")
"""Settings that nobody states: of the database, and which worker of a host a process is."""


@with_settings(*(name for name in Settings.model_fields if name not in _INTERNAL))
def serve(
    *,
    settings: dict[str, Any],
    log_format: Annotated[
        LogFormat,
        typer.Option(metavar="FORM", help="text for people, json for programs that gather logs."),
    ] = "text",
) -> None:
    """Run the service until Ctrl-C or SIGTERM.

    Example: `thermap serve --port 8001 --database-url sqlite:///shop.db`
    """
    chosen = checked_settings(settings)
    write_log_as(log_format)
    if chosen.workers > 1 and not is_postgresql(chosen.database_url):
        raise typer.BadParameter(
            f"{chosen.workers} need PostgreSQL, which tells each what the others stored; "
            "on SQLite a reading sent to one would be in the tables of the others a second later",
            param_hint="--workers",
        )
    with exiting_on_signals(), listening(chosen.host, chosen.port, "serve") as opened:
        service = make_service(chosen)
        first = create_first_key(service.state.context.database) if chosen.asks_for_keys else None
        echo(f"thermap {package.__version__} listens on {url_of(opened)}")
        echo(f"  dashboard         {url_of(opened)}/")
        echo(f"  to read and try   {url_of(opened)}/docs")
        echo(f"  database          {database_of(service)}{new_database_note(service)}")
        if chosen.opcua_endpoint:
            echo(f"  OPC UA            {chosen.opcua_endpoint}")
        if first is not None:
            echo(f"  key (admin)       {first}")
            echo("                    shown this once; `thermap keys create` makes others")
        elif chosen.insecure and not is_this_computer(chosen.host):
            echo("  no keys           who reaches this address may change everything")
        if chosen.workers > 1:
            echo(f"  workers           {chosen.workers}")
        echo("  Ctrl-C stops it")
        if chosen.workers > 1:
            service.state.context.database.close()  # each worker has connections of its own
            Workers(chosen, opened, chosen.workers, log_format).run()
        server_for(service, chosen.log_level).run([opened])
