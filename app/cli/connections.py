"""thermap connections: how what the service reads beside HTTP fares, and a look at its file."""

from __future__ import annotations

import socket
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Group, RenderableType
from rich.text import Text

from app.cli.answers import listing, or_nothing, when
from app.cli.asking import Shown, asks, calls
from app.cli.terminal import echo
from app.errors import InvalidContent, counted, list_names

if TYPE_CHECKING:
    from thermap.answers import Connection, ConnectionsNow

connections = typer.Typer(
    invoke_without_command=True, add_completion=False, rich_markup_mode="markdown"
)


@connections.callback()
@asks
def how_they_fare(ctx: typer.Context) -> Shown | None:
    """Show how connections beside HTTP fare, or check their file.

    Example: `thermap connections`, `thermap connections check thermap.toml`
    """
    if ctx.invoked_subcommand is not None:
        return None
    return Shown(calls.connections(), connections_view)


@connections.command()
def check(
    file: Annotated[
        Path,
        typer.Argument(
            envvar="THERMAP_CONFIG", metavar="FILE.toml", help="As for `thermap serve --config`."
        ),
    ],
) -> None:
    """Check a file of connections whole, as the service does before it starts.

    Nobody is connected to; whether machines and sensors exist, only the service knows.

    Example: `thermap connections check thermap.toml`
    """
    from app.connections.config import read_connections

    connections_file = read_connections(file)
    for what, named in (
        ("connection", connections_file.connections),
        ("receiver", connections_file.notify),
    ):
        if named or what == "connection":
            number = counted(len(named), what)
            echo(f"{file}: {number}: {list_names(table.name for table in named)}")


@connections.command()
def certificate(
    file: Annotated[
        Path, typer.Argument(metavar="FILE.der", help="The certificate: to be given to others.")
    ],
    key: Annotated[
        Path, typer.Argument(metavar="FILE.pem", help="Its private key: to be kept to ourselves.")
    ],
    *,
    hosts: Annotated[
        list[str] | None,
        typer.Option(
            "--host",
            metavar="NAME",
            show_default="this computer's own name",
            help="Name or address under which OPC UA clients reach the service; may be repeated.",
        ),
    ] = None,
) -> None:
    """Make a certificate by which OPC UA servers and clients know this service.

    It signs itself, and is valid for five years.

    Example: `thermap connections certificate thermap.der thermap.pem`
    """
    try:
        from app.connections.opcua_certificates import write_pair
    except ImportError:
        raise InvalidContent(
            'certificates are made with the extra opcua: pip install "thermap[opcua]"'
        ) from None
    names = hosts or [socket.gethostname()]
    try:
        written = write_pair(file, key, f"urn:{names[0]}:thermap", names)
    except OSError as why:
        raise InvalidContent(
            f"expected to make the new files {file} and {key}: {why.strerror}: {why.filename}"
        ) from None
    echo(f"{file}: {written.words}, valid to {written.content.not_valid_after_utc:%Y-%m-%d}")
    echo(f"{key}: its private key, which nobody else may read")


def connections_view(found: ConnectionsNow) -> RenderableType:
    """Lay out all connections, those with trouble first, and what became of what they read."""
    table = listing("name", "kind", "machines", "contact", "last value (UTC)", "values", "trouble")
    for connection in sorted(
        found.connections, key=lambda item: (item.connected, not item.trouble)
    ):
        table.add_row(
            connection.name,
            connection.kind,
            list_names(connection.machines, limit=3),
            Text("yes") if connection.connected else Text("no", style="bold red"),
            when(connection.last_value_at),
            str(connection.known),
            Text(_trouble(connection)),
        )
    counts = (
        f"{counted(found.stored, 'reading')} stored, {found.dropped} dropped, "
        f"{counted(found.refused, 'value')} refused"
    )
    if found.wrong_clocks:
        of = list_names(found.machines_with_wrong_clocks, limit=5)
        now = f"; now of {of}" if found.machines_with_wrong_clocks else ""
        counts += f", {counted(found.wrong_clocks, 'value')} with a wrong clock{now}"
    last = [Text(f"last refused: {found.last_refusal}")] if found.last_refusal else []
    nothing = "no connections; `thermap serve --config FILE.toml` names their file"
    return Group(or_nothing(table, nothing), Text(), Text(counts), *last)


def _trouble(connection: Connection) -> str:
    """Say what is the matter, and what was lost."""
    lost = f"{counted(connection.lost, 'observation')} lost" if connection.lost else ""
    return "; ".join(words for words in (connection.trouble, lost) if words)
