"""thermap doctor: whether all is well, one sentence for each thing."""

from __future__ import annotations

import json as json_text
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.text import Text

from app.cli.answers import listing, show_view
from app.cli.examine_service import examine_service
from app.cli.options import DatabaseOption, UrlOption, is_typed
from app.cli.settings_options import blamed_option
from app.cli.terminal import echo
from app.connections.config import read_connections
from app.errors import InvalidContent, ThermapError
from app.services.doctor import (
    Finding,
    Grade,
    examine_backups,
    examine_database,
    ok,
    trouble,
    worst,
)
from thermap import DEFAULT_URL

_STYLES: Final = {Grade.OK: "", Grade.WARNING: "bold yellow", Grade.TROUBLE: "bold red"}


def doctor(
    ctx: typer.Context,
    *,
    url: UrlOption = DEFAULT_URL,
    database_url: DatabaseOption,
    config: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="What `thermap serve --config` is given: whether it could start with it.",
        ),
    ] = None,
    backups: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Where backups are kept: how old the newest is, and whether it is whole.",
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="For programs.")] = False,
) -> None:
    """Say whether all is well with a database and the service on it; exit code 1 where not.

    It looks and changes nothing. With --url alone it asks that service only, with --database-url
    alone it looks at that database only, whether a service runs on it or not.

    Example: `thermap doctor --backups /srv/backups`
    """
    sources = {name for name in ("url", "database_url") if is_typed(ctx, name)}
    parts: list[Iterator[Finding]] = []
    if sources != {"url"}:
        parts.append(_database(database_url))
    if sources != {"database_url"}:
        parts.append(examine_service(url, must_run="url" in sources))
    if config is not None:
        parts.append(_config(config))
    if backups is not None:
        parts.append(iter([examine_backups(backups)]))
    findings = [finding for part in parts for finding in part]
    verdict = worst(findings)
    if json:
        echo(
            json_text.dumps(
                {"verdict": verdict, "findings": [asdict(finding) for finding in findings]},
                ensure_ascii=False,
            )
        )
    else:
        table = listing("", "about", "")
        for finding_ in findings:
            table.add_row(
                Text(finding_.grade, style=_STYLES[finding_.grade]),
                finding_.about,
                finding_.sentence,
            )
        show_view(table)
    if verdict is Grade.TROUBLE:
        raise typer.Exit(1)


def _database(url: str) -> Iterator[Finding]:
    try:
        yield from examine_database(url)
    except InvalidContent as error:
        raise blamed_option(error) or error from None


def _config(file: Path) -> Iterator[Finding]:
    try:
        read_connections(file)
    except ThermapError as error:
        yield trouble("config", f"{error.detail.removeprefix('config: ')}.")
    else:
        yield ok("config", f"{file} can be read, and says nothing that is not known.")
