"""thermap worker: analyses for the services on a database, without a service."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

import typer

import app as package
from app.cli.beat import Beat, check_beat
from app.cli.logs import LogFormat, write_log_as
from app.cli.options import DatabaseOption
from app.cli.terminal import echo
from app.errors import InvalidContent, counted

if TYPE_CHECKING:
    from app.storage.database import Database

FINISH_S: Final = 10.0
"""How long what runs may still take when a worker ends [s]."""


def worker(
    *,
    database_url: DatabaseOption,
    concurrency: Annotated[
        int,
        typer.Option(
            metavar="N",
            min=1,
            max=64,
            help="Analyses at the same time, each a process that uses one core.",
        ),
    ] = 1,
    finish_s: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            min=0.0,
            max=86_400.0,
            help="How long what runs may still take after Ctrl-C or SIGTERM, in s; then it goes "
            "back to the queue. The second signal does not wait.",
        ),
    ] = FINISH_S,
    log_level: Annotated[
        Literal["debug", "info", "warning", "error", "critical"],
        typer.Option(metavar="LEVEL", help="debug, info, warning, error or critical."),
    ] = "info",
    log_format: Annotated[
        LogFormat,
        typer.Option(metavar="FORM", help="text for people, json for programs that gather logs."),
    ] = "text",
    beat_file: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Where the worker writes every few seconds that it lives, for --check.",
        ),
    ] = None,
    check: Annotated[
        bool,
        typer.Option(
            "--check",
            help="Run nothing: say whether the worker that writes --beat-file lives; exit code 1 "
            "where not.",
        ),
    ] = False,
) -> None:
    """Run the analyses that services are asked for, until Ctrl-C or SIGTERM.

    Any number of workers, on any hosts that reach the database, share its queue. With SQLite it
    is a process beside the service, on the same computer.

    Example: `thermap worker --database-url postgresql://thermap@db/thermap --concurrency 4`
    """
    if check:
        _check(beat_file)
        return
    write_log_as(log_format)
    logging.getLogger("thermap").setLevel(log_level.upper())
    database = _opened(database_url)
    try:
        _work(database, concurrency, finish_s, Beat(beat_file))
    finally:
        database.close()


def _check(beat_file: Path | None) -> None:
    if beat_file is None:
        raise typer.BadParameter(
            "expected the file that the worker writes, got none", param_hint="--beat-file"
        )
    lives, words = check_beat(beat_file)
    echo(words, err=not lives)
    if not lives:
        raise typer.Exit(1)


def _work(database: Database, concurrency: int, finish_s: float, beat: Beat) -> None:
    """Run analyses until a signal."""
    # A check is made every few seconds, and needs none of these.
    from app.cli.listening import exiting_on_signals, wait_for_signal
    from app.services.context import Context
    from app.services.run_analyses import make_runner
    from app.storage.migrate import upgrade

    runner = make_runner(Context(database), concurrency=concurrency, looked=beat.write)
    try:
        upgrade(database)
        with exiting_on_signals():
            beat.begin()
            runner.start()
            jobs = counted(concurrency, "analysis", "analyses")
            echo(f"thermap {package.__version__} runs {jobs} at a time")
            echo(f"  database          {database.name}")
            echo("  Ctrl-C stops it")
            try:
                wait_for_signal()
            finally:
                runner.stop(finish_s=finish_s)  # a second signal leaves this
    finally:
        runner.stop()
        beat.end()


def _opened(database_url: str) -> Database:
    """Open a database that is there; a URL that is none is wrong usage."""
    from app.cli.settings_options import blamed_option
    from app.storage.database import Database

    try:
        return Database(database_url, may_be_new=False)
    except InvalidContent as error:
        raise blamed_option(error) or error from None
