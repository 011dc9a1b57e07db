"""thermap serve: the service, one process or several that share its socket."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

import app as package
from app.cli.listening import (
    DEFAULT_HOST,
    DEFAULT_PORT,
    AllowedHostOption,
    CorsOption,
    ForwardedOption,
    HostOption,
    InsecureOption,
    PortOption,
    RequireKeysOption,
    checked_settings,
    database_of,
    exiting_on_signals,
    listening,
    make_service,
    new_database_note,
    server_for,
    url_of,
)
from app.cli.logs import LogFormat, write_log_as
from app.cli.terminal import echo
from app.cli.workers import Workers
from app.services.access_keys import create_first_key
from app.settings import Settings, is_postgresql, is_this_computer, sqlite_url

_FIELDS = Settings.model_fields


def serve(
    *,
    host: HostOption = DEFAULT_HOST,
    port: PortOption = DEFAULT_PORT,
    allowed_hosts: AllowedHostOption = None,
    cors_origins: CorsOption = None,
    forwarded_allow_ips: ForwardedOption = None,
    require_keys: RequireKeysOption = False,
    insecure: InsecureOption = False,
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
            envvar="THERMAP_MAX_BODY_BYTES", metavar="N", help="Largest body of any request."
        ),
    ] = _FIELDS["max_body_bytes"].default,
    patience_s: Annotated[
        float,
        typer.Option(
            envvar="THERMAP_PATIENCE_S",
            metavar="SECONDS",
            help="How long a request may stop half-way before it is ended, in s.",
        ),
    ] = _FIELDS["patience_s"].default,
    refresh_s: Annotated[
        float,
        typer.Option(
            envvar="THERMAP_REFRESH_S",
            metavar="SECONDS",
            help="How often the database is asked whether it is there and, on SQLite, what is new, "
            "in s.",
        ),
    ] = _FIELDS["refresh_s"].default,
    statement_limit_s: Annotated[
        float,
        typer.Option(
            envvar="THERMAP_STATEMENT_LIMIT_S",
            metavar="SECONDS",
            help="Longest that PostgreSQL may take for one statement of a request, in s.",
        ),
    ] = _FIELDS["statement_limit_s"].default,
    waiting_requests: Annotated[
        int,
        typer.Option(
            envvar="THERMAP_WAITING_REQUESTS",
            metavar="N",
            help="Requests that may wait for the database; more are sent away with 503.",
        ),
    ] = _FIELDS["waiting_requests"].default,
    analyses: Annotated[
        bool,
        typer.Option(
            "--analyses/--no-analyses",
            envvar="THERMAP_ANALYSES",
            help="Run analyses too, or leave them to `thermap worker` processes.",
        ),
    ] = _FIELDS["analyses"].default,
    waiting_analyses: Annotated[
        int,
        typer.Option(
            envvar="THERMAP_WAITING_ANALYSES",
            metavar="N",
            help="Analyses that may wait, of all machines; more are refused with 503.",
        ),
    ] = _FIELDS["waiting_analyses"].default,
    waiting_analyses_of_machine: Annotated[
        int,
        typer.Option(
            envvar="THERMAP_WAITING_ANALYSES_OF_MACHINE",
            metavar="N",
            help="Analyses of one machine that may wait; more are refused with 429.",
        ),
    ] = _FIELDS["waiting_analyses_of_machine"].default,
    config: Annotated[
        Path | None,
        typer.Option(
            envvar="THERMAP_CONFIG",
            metavar="FILE.toml",
            show_default="no connections",
            help="What the service reads beside HTTP, such as MTConnect agents.",
        ),
    ] = None,
    opcua_endpoint: Annotated[
        str,
        typer.Option(
            envvar="THERMAP_OPCUA_ENDPOINT",
            metavar="URL",
            show_default="no OPC UA server",
            help="Where OPC UA clients read tables, as opc.tcp://127.0.0.1:4840/thermap.",
        ),
    ] = _FIELDS["opcua_endpoint"].default,
    keep_readings: Annotated[
        int | None,
        typer.Option(
            envvar="THERMAP_KEEP_READINGS",
            metavar="DAYS",
            show_default="for ever",
            min=31,
            help="Age from which readings are deleted, but for those that verifications need; "
            "at least 31.",
        ),
    ] = None,
    thin_readings_after: Annotated[
        int | None,
        typer.Option(
            envvar="THERMAP_THIN_READINGS_AFTER",
            metavar="DAYS",
            show_default="never",
            min=31,
            help="Age from which readings are thinned, but for those that maps, verifications and "
            "adopted lags need; at least 31.",
        ),
    ] = None,
    thin_readings_to_s: Annotated[
        float,
        typer.Option(
            envvar="THERMAP_THIN_READINGS_TO_S",
            metavar="SECONDS",
            help="Of each sensor one value in so long is left of what is thinned.",
        ),
    ] = _FIELDS["thin_readings_to_s"].default,
    workers: Annotated[
        int,
        typer.Option(
            envvar="THERMAP_WORKERS",
            metavar="N",
            min=1,
            help="Processes that answer side by side; more than one needs PostgreSQL.",
        ),
    ] = _FIELDS["workers"].default,
    log_level: Annotated[
        Literal["debug", "info", "warning", "error", "critical"],
        typer.Option(
            envvar="THERMAP_LOG_LEVEL",
            metavar="LEVEL",
            help="debug, info, warning, error or critical.",
        ),
    ] = _FIELDS["log_level"].default,
    log_format: Annotated[
        LogFormat,
        typer.Option(
            envvar="THERMAP_LOG_FORMAT",
            metavar="FORM",
            help="text for people, json for programs that gather logs.",
        ),
    ] = "text",
) -> None:
    """Run the service until Ctrl-C or SIGTERM.

    Example: `thermap serve --port 8001 --database-url sqlite:///shop.db`
    """
    settings = checked_settings(
        host=host,
        port=port,
        allowed_hosts=allowed_hosts or (),
        cors_origins=cors_origins or (),
        forwarded_allow_ips=forwarded_allow_ips or (),
        require_keys=require_keys,
        insecure=insecure,
        database_url=database_url,
        max_body_bytes=max_body_bytes,
        patience_s=patience_s,
        refresh_s=refresh_s,
        statement_limit_s=statement_limit_s,
        waiting_requests=waiting_requests,
        analyses=analyses,
        waiting_analyses=waiting_analyses,
        waiting_analyses_of_machine=waiting_analyses_of_machine,
        opcua_endpoint=opcua_endpoint,
        config=config,
        keep_readings=keep_readings,
        thin_readings_after=thin_readings_after,
        thin_readings_to_s=thin_readings_to_s,
        workers=workers,
        log_level=log_level,
    )
    write_log_as(log_format)
    if workers > 1 and not is_postgresql(settings.database_url):
        raise typer.BadParameter(
            f"{workers} need a PostgreSQL database, which tells each what the others stored; on "
            "SQLite a reading sent to one would be in the tables of the others a second later",
            param_hint="--workers",
        )
    with exiting_on_signals(), listening(settings.host, settings.port, "serve") as opened:
        service = make_service(settings)
        first = create_first_key(service.state.context.database) if settings.asks_for_keys else None
        echo(f"thermap {package.__version__} listens on {url_of(opened)}")
        echo(f"  dashboard         {url_of(opened)}/")
        echo(f"  to read and try   {url_of(opened)}/docs")
        echo(f"  database          {database_of(service)}{new_database_note(service)}")
        if settings.opcua_endpoint:
            echo(f"  OPC UA            {settings.opcua_endpoint}")
        if first is not None:
            echo(f"  key (admin)       {first}")
            echo("                    shown this once; `thermap keys create` makes others")
        elif settings.insecure and not is_this_computer(settings.host):
            echo("  no keys           who reaches this address may change everything")
        if workers > 1:
            echo(f"  workers           {workers}")
        echo("  Ctrl-C stops it")
        if workers > 1:
            service.state.context.database.close()  # each worker has connections of its own
            Workers(settings, opened, workers, log_format).run()
        server_for(service, settings.log_level).run([opened])
