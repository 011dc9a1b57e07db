"""thermap replay: recorded temperatures, sent as readings."""

from __future__ import annotations

import time
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta, tzinfo
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)

from app.cli.csv_recording import TIME_COLUMNS, read_recording
from app.cli.delimited_text import left_out
from app.cli.options import MachineArgument, UrlOption, connect, read_time
from app.cli.replay_times import Plan, Stamps, plan_replay
from app.cli.table_change import change_view, component_changes, sampled_tables
from app.errors import counted, list_names
from thermap import DEFAULT_URL, ConflictError, ThermapClient
from thermap.answers import MachineAnswer

_LONGEST_SLEEP_S = 0.2
_WARY = timedelta(minutes=2)
"""How long after other readings a different one seems to have jumped."""


def replay(
    machine: MachineArgument,
    file: Annotated[Path, typer.Argument(metavar="FILE.csv", help="Recorded temperatures in °C.")],
    speed: Annotated[
        float,
        typer.Option(
            envvar="THERMAP_SPEED", min=0.0, help="Times faster than recorded; 0: all at once."
        ),
    ] = 60.0,
    fast: Annotated[
        bool, typer.Option("--fast", envvar="THERMAP_FAST", help="The same as --speed 0.")
    ] = False,
    recorded_times: Annotated[
        bool,
        typer.Option(
            "--recorded-times",
            envvar="THERMAP_RECORDED_TIMES",
            help="Keep the recorded times at any speed.",
        ),
    ] = False,
    start: Annotated[
        str | None,
        typer.Option(
            envvar="THERMAP_START",
            metavar="TIME",
            help="When a recording without dates began, ISO 8601 with its zone.",
            show_default="so that it ends now",
        ),
    ] = None,
    column: Annotated[
        list[str] | None,
        typer.Option(
            envvar="THERMAP_COLUMNS",
            metavar="NAME=SENSOR",
            help="What a column holds: a sensor, or time_s, time_min, time_h, time.",
        ),
    ] = None,
    utc_offset: Annotated[
        str | None,
        typer.Option(
            envvar="THERMAP_UTC_OFFSET", metavar="±HH:MM", help="Zone of times that state none."
        ),
    ] = None,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """Send recorded temperatures as readings, and show how the compensation table changes.

    The file has a column `time` (ISO 8601 with its zone) or `time_s`, `time_min`,
    `time_h` (counted from the beginning), and columns named as the sensors (`x-middle`
    or `x-middle_c`, °C); other columns are left out.

    Readings are stamped as they are sent. Where that would make sensors seem to jump
    they keep their recorded spacing and end now. With --fast they keep their
    recorded times. The service refuses times in the future.

    Example: `thermap replay mcfv5050 warm-up.csv --speed 60`
    """
    columns = _read_columns(column)
    with connect(url) as thermap:
        described = thermap.machine(machine)
        recording = read_recording(
            file, _checked_sensors(described, columns), columns, _read_zone(utc_offset)
        )
        if recording.unread:
            typer.echo(left_out(recording.unread), err=True)
        plan = plan_replay(
            recording,
            described.sensors,
            now=datetime.now(UTC),
            speed=0.0 if fast else speed,
            start=None if start is None else read_time(start, "--start"),
            recorded_times=recorded_times,
        )
        _announce(thermap, machine, file, plan)
        _send(thermap, machine, plan)
        _show_change(thermap, machine, plan)


def _announce(thermap: ThermapClient, machine: str, file: Path, plan: Plan) -> None:
    first, last = plan.readings[0].time, plan.readings[-1].time
    reason = f": {plan.reason}" if plan.reason else ""
    typer.echo(f"{file}: {counted(len(plan.readings), 'reading')} {plan.stamps}{reason}", err=True)
    if plan.stamps is not Stamps.AS_SENT:
        typer.echo(f"from {first:%Y-%m-%d %H:%M:%S} to {last:%Y-%m-%d %H:%M:%S} UTC", err=True)
    if thermap.readings(machine, since=first - _WARY, limit=1):
        typer.echo(
            f"note: {machine} has other readings from about that time on; where they differ, "
            "its sensors will seem to jump and there is no live table",
            err=True,
        )


def _send(thermap: ThermapClient, machine: str, plan: Plan) -> None:
    """Send each reading when it is due; those that are due together go together."""
    sent = stored = 0
    began = time.monotonic()
    try:
        with _progress(len(plan.readings)) as (progress, task):
            while sent < len(plan.readings):
                elapsed_s = time.monotonic() - began
                due = bisect_right(plan.due_s, elapsed_s)
                if due == sent:
                    time.sleep(min(plan.due_s[sent] - elapsed_s, _LONGEST_SLEEP_S))
                    continue
                stored += thermap.store_readings(machine, plan.readings[sent:due]).stored
                sent = due
                progress.update(task, completed=sent)
    except KeyboardInterrupt:
        typer.echo(f"stopped after {sent} of {counted(len(plan.readings), 'reading')}", err=True)
        raise typer.Exit(130) from None
    typer.echo(f"{counted(stored, 'reading')} stored, {sent - stored} there already")


@contextmanager
def _progress(total: int) -> Iterator[tuple[Progress, TaskID]]:
    """Show a bar on a terminal, nothing in a pipe."""
    console = Console(stderr=True)
    columns = (TextColumn("sending"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        yield progress, progress.add_task("sending", total=total)


def _show_change(thermap: ThermapClient, machine: str, plan: Plan) -> None:
    console = Console(highlight=False)
    tables = sampled_tables(thermap, machine, [r.temperatures_c for r in plan.readings])
    if tables:
        console.print(change_view(component_changes(tables)))
    else:
        console.print("no reading of these has a compensation table")
    try:
        tagged = thermap.current_table(machine)
    except ConflictError as error:
        console.print(f"no live table: {error.detail}")
        return
    assert tagged is not None  # without an ETag there is always a table
    table = tagged.table
    newer = table.reading_time > plan.readings[-1].time + timedelta(milliseconds=1)
    console.print(
        f"live table: {'a newer reading' if newer else 'the last reading'} of "
        f"{table.reading_time:%Y-%m-%d %H:%M:%S} UTC, {table.reading_age_s:.0f} s old, "
        f"{'complete' if table.complete else 'not complete'}"
    )
    for warning in table.warnings:
        console.print(f"! {warning}", style="yellow")


def _read_columns(stated: list[str] | None) -> dict[str, str]:
    found = {}
    for text in stated or ():
        name, equals, sensor = (part.strip() for part in text.rpartition("="))
        if not name or not equals or not sensor:
            raise typer.BadParameter(f"expected NAME=SENSOR, came {text!r}", param_hint="--column")
        found[name] = sensor
    return found


def _checked_sensors(machine: MachineAnswer, columns: Mapping[str, str]) -> list[str]:
    """Name the machine's sensors; a column of any other is wrong usage."""
    sensors = [sensor.name for sensor in machine.sensors]
    unknown = sorted(set(columns.values()) - {*sensors, *TIME_COLUMNS})
    if unknown:
        raise typer.BadParameter(
            f"machine {machine.id!r} has no sensor {list_names(unknown)}; "
            f"it has {list_names(sensors)}",
            param_hint="--column",
        )
    return sensors


def _read_zone(text: str | None) -> tzinfo | None:
    if text is None:
        return None
    try:
        return datetime.fromisoformat(f"2000-01-01T00:00:00{text}").tzinfo or UTC
    except ValueError:
        raise typer.BadParameter(
            f"expected an offset such as +01:00, came {text!r}", param_hint="--utc-offset"
        ) from None
