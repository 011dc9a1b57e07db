"""thermap serve: the service, one process."""

from __future__ import annotations

import logging
from typing import Annotated, Literal

import typer

import app as package
from app.cli.listening import (
    checked_settings,
    database_of,
    leaving_on_signals,
    listening,
    make_service,
    server_for,
    url_of,
)
from app.cli.options import DEFAULT_HOST, DEFAULT_PORT, HostOption, PortOption
from app.settings import Settings, sqlite_url

_FIELDS = Settings.model_fields


def serve(
    *,
    host: HostOption = DEFAULT_HOST,
    port: PortOption = DEFAULT_PORT,
    database_url: Annotated[
        str,
        typer.Option(
            envvar="THERMAP_DATABASE_URL",
            metavar="URL",
            default_factory=lambda: sqlite_url("thermap.db"),
            show_default="thermap.db in your folder for data",
            help="sqlite:///FILE or postgresql://HOST/NAME.",
        ),
    ],
    max_body_bytes: Annotated[
        int,
        typer.Option(
            envvar="THERMAP_MAX_BODY_BYTES", metavar="N", min=1, help="Largest body of a request."
        ),
    ] = _FIELDS["max_body_bytes"].default,
    refresh_s: Annotated[
        float,
        typer.Option(
            envvar="THERMAP_REFRESH_S",
            metavar="SECONDS",
            help="How often the database is looked at for others' changes, in s.",
        ),
    ] = _FIELDS["refresh_s"].default,
    log_level: Annotated[
        Literal["debug", "info", "warning", "error", "critical"],
        typer.Option(
            envvar="THERMAP_LOG_LEVEL",
            metavar="LEVEL",
            help="debug, info, warning, error or critical.",
        ),
    ] = _FIELDS["log_level"].default,
) -> None:
    """Run the service until Ctrl-C or SIGTERM.

    Example: `thermap serve --port 8001 --database-url sqlite:///shop.db`
    """
    settings = checked_settings(
        host=host,
        port=port,
        database_url=database_url,
        max_body_bytes=max_body_bytes,
        refresh_s=refresh_s,
        log_level=log_level,
    )
    logging.basicConfig(format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    with leaving_on_signals(), listening(settings.host, settings.port, "serve") as opened:
        service = make_service(settings)
        typer.echo(f"thermap {package.__version__} listens on {url_of(opened)}")
        typer.echo(f"  to read and try   {url_of(opened)}/docs")
        typer.echo(f"  database          {database_of(service)}")
        typer.echo("  Ctrl-C stops it")
        server_for(service, settings.log_level).run([opened])
