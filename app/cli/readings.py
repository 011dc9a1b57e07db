"""thermap readings: list the temperatures that came, and withdraw those that were wrong."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.console import Group, RenderableType
from rich.text import Text

from app.cli.answers import listing, temperatures, when
from app.cli.asking import ChosenMachine, Shown, ThermapClient, asks, calls
from app.cli.options import YesOption, command_group, confirm, time_option
from app.cli.terminal import echo
from app.errors import counted
from app.units import exact_time

if TYPE_CHECKING:
    from thermap.answers import ReadingSchema, WithdrawnReadingAnswer

readings = command_group()

USUAL_SPAN: Final = timedelta(hours=1)
"""How far back is listed where nothing is stated."""

MOST_COUNTED: Final = 10_000
"""Before they are withdrawn, readings are counted so far."""


@readings.command("list")
@asks
def list_readings(
    machine: ChosenMachine,
    since: Annotated[
        datetime | None,
        time_option(
            "--from", "From this time on, ISO 8601 with its zone.", show_default="an hour ago"
        ),
    ] = None,
    until: Annotated[datetime | None, time_option("--to", "Up to this time.")] = None,
    every_s: Annotated[
        float,
        typer.Option("--every-s", min=0.0, help="At most one in so many seconds."),
    ] = 60.0,
    limit: Annotated[
        int,
        typer.Option(min=1, max=100_000, help="At most so many readings."),
    ] = 1000,
    withdrawn: Annotated[
        bool,
        typer.Option(
            "--withdrawn",
            help="Those that were withdrawn, all of them, and when; --every-s does not apply.",
        ),
    ] = False,
) -> Shown:
    """List readings in order of time: the last hour, one a minute, if nothing is stated.

    Example: `thermap readings list --machine vmc --from 2026-03-01T06:00:00Z --every-s 600`
    """
    if withdrawn:
        call = calls.withdrawn_readings(machine, since, until, limit)
        return Shown(call, lambda answer: withdrawn_view(answer, limit))
    first = since or datetime.now(UTC) - USUAL_SPAN
    return Shown(
        calls.readings(machine, first, until, every_s, limit),
        lambda answer: readings_view(answer, first, limit),
    )


@readings.command("withdraw")
@asks
def withdraw(
    thermap: ThermapClient,
    machine: ChosenMachine,
    time: Annotated[
        datetime | None,
        time_option("--time", "The one reading of exactly this time, ISO 8601 with its zone."),
    ] = None,
    since: Annotated[
        datetime | None, time_option("--from", "All from this time on, with --to.")
    ] = None,
    until: Annotated[
        datetime | None, time_option("--to", "All up to this time, with --from.")
    ] = None,
    yes: YesOption = False,
) -> None:
    """Take readings out of use: they count in no table, prediction or analysis any more.

    For readings of a clock that was wrong, or of a sensor that hung somewhere else.

    Example: `thermap readings withdraw --machine vmc --time 2026-03-01T06:00:00Z`
    """
    first, last = _span(time, since, until)
    number = len(thermap.readings(machine, first, last, limit=MOST_COUNTED))
    what = counted(number, "reading") + (" or more" if number == MOST_COUNTED else "")
    when = f"of {exact_time(first)}" if time else f"from {exact_time(first)} to {exact_time(last)}"
    are = "was" if number == 1 else "were"
    confirm(
        f"{what} of {machine!r} {are} not withdrawn",
        f"Withdraw {what} of {machine!r} {when}?",
        yes=yes,
    )
    done = (
        thermap.withdraw_reading(machine, first)
        if time
        else thermap.withdraw_readings(machine, first, last)
    )
    echo(f"{counted(done.withdrawn, 'reading')} {when} withdrawn")


def _span(
    time: datetime | None, since: datetime | None, until: datetime | None
) -> tuple[datetime, datetime]:
    """Say which readings are meant; the one of a time lies between it and itself."""
    if time is not None and since is None and until is None:
        return time, time
    if time is None and since is not None and until is not None:
        return since, until
    raise typer.BadParameter(
        "expected --time of one reading, or --from and --to of all between them; one of these "
        "without the other would mean all readings before or after it",
        param_hint="--time",
    )


def readings_view(found: Sequence[ReadingSchema], first: datetime, limit: int) -> RenderableType:
    """Lay out readings.

    Parameters
    ----------
    found
        In order of time.
    limit
        How many were asked for; as many may not be all.
    """
    if not found:
        return Text(f"no reading since {first:%Y-%m-%d %H:%M:%S} UTC; --from reaches further back")
    has_state = any(one.state for one in found)
    headings = ("time [UTC]", "temperatures [°C]", *(["state"] if has_state else []))
    table = listing(*headings, right="L")
    for reading in found:
        state = ", ".join(f"{name} {value:g}" for name, value in reading.state.items())
        cells = [_seconds(reading.time), temperatures(reading.temperatures_c)]
        table.add_row(*cells, *([state] if has_state else []))
    return Group(table, *([_more(limit)] if len(found) >= limit else []))


def withdrawn_view(found: Sequence[WithdrawnReadingAnswer], limit: int) -> RenderableType:
    """Lay out readings that were withdrawn; as many as the limit may not be all."""
    if not found:
        return Text("no reading was withdrawn")
    table = listing("time [UTC]", "withdrawn [UTC]", "temperatures [°C]", right="L")
    for reading in found:
        table.add_row(
            _seconds(reading.time), when(reading.withdrawn_at), temperatures(reading.temperatures_c)
        )
    return Group(table, *([_more(limit)] if len(found) >= limit else []))


def _more(limit: int) -> Text:
    return Text(f"! the first {limit}; there may be more: --from, --every-s and --limit choose")


def _seconds(time: datetime) -> str:
    """Write a time with all its digits: it names the reading, to be withdrawn for example."""
    fraction = f".{time.microsecond:06d}".rstrip("0") if time.microsecond else ""
    return f"{time:%Y-%m-%d %H:%M:%S}{fraction}"
