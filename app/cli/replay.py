"""thermap replay: recorded temperatures and states, sent as readings, and how the table changed.

A recording sent faster than it was recorded and stamped as it is sent seems to warm up
faster than any machine does, and the service rightly takes that for sensors that jump.
So where that would happen the readings keep their recorded spacing instead.
"""

from __future__ import annotations

import time
from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, tzinfo
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Final

import numpy as np
import typer
from rich.console import Group, RenderableType
from rich.progress import MofNCompleteColumn, TimeRemainingColumn
from rich.text import Text

from app.arrays import FloatArray
from app.cli.answers import listing
from app.cli.asking import ThermapClient, asks
from app.cli.compensate import evenly_chosen, signed
from app.cli.console import console, progress_bar
from app.cli.options import MachineArgument, Named, named, time_option
from app.cli.terminal import echo
from app.errors import counted, list_names
from app.files.recording import TIME_COLUMNS, Recording, is_state, read_recording
from app.live.reading_window import kept_spacing_s
from app.thermal.machine import Sensor
from app.thermal.sensor_health import CLEARLY
from app.units import SECONDS_PER_MIN
from thermap import ConflictError, InvalidContentError
from thermap.answers import CompensationAnswer, MachineAnswer, ReadingSchema, SensorSchema

_LONGEST_SLEEP_S = 0.2
_JUMP_WITHIN = timedelta(minutes=2)
"""How long after other readings a different one seems to have jumped."""

SAMPLES: Final = 60
"""Tables that are asked for over a replay; the temperatures change slowly."""


def _zone(text: str) -> tzinfo:
    try:
        return datetime.fromisoformat(f"2000-01-01T00:00:00{text}").tzinfo or UTC
    except ValueError:
        raise typer.BadParameter(f"expected an offset such as +01:00, got {text!r}") from None


@asks
def replay(
    thermap: ThermapClient,
    machine: MachineArgument,
    file: Annotated[Path, typer.Argument(metavar="FILE.csv", help="Recorded temperatures in °C.")],
    speed: Annotated[
        float,
        typer.Option(min=0.0, help="Times faster than recorded; 0: all at once."),
    ] = 60.0,
    recorded_times: Annotated[
        bool,
        typer.Option("--recorded-times", help="Keep the recorded times at any speed."),
    ] = False,
    start: Annotated[
        datetime | None,
        time_option(
            "--start",
            "When a recording without dates began, ISO 8601 with its zone.",
            show_default="so that it ends now",
        ),
    ] = None,
    column: Annotated[
        Named | None,
        typer.Option(
            envvar="THERMAP_COLUMNS",
            metavar="NAME=SENSOR",
            parser=named("NAME=SENSOR"),
            help="What a column holds: a sensor, `state NAME`, or time_s, time_min, time_h, time.",
        ),
    ] = None,
    utc_offset: Annotated[
        tzinfo | None,
        typer.Option(metavar="±HH:MM", parser=_zone, help="Zone of times that state none."),
    ] = None,
) -> None:
    """Send recorded temperatures as readings, and show how the compensation table changes.

    The file has a column `time` (ISO 8601 with its zone) or `time_s`, `time_min`,
    `time_h` (counted from the beginning), and columns named as the sensors (`x-middle`
    or `x-middle_c`, °C). Columns `state NAME` (`state spindle_rpm`) are sent as the
    machine's state with the temperatures. Other columns are left out.

    Readings are stamped as they are sent. Where that would make sensors seem to jump
    they keep their recorded spacing and end now. With --speed 0 they keep their
    recorded times. The service refuses times in the future.

    Example: `thermap replay mcfv5050 warm-up.csv --speed 60`
    """
    columns = column or {}
    described = thermap.machine(machine)
    recording = read_recording(file, _checked_sensors(described, columns), columns, utc_offset)
    if recording.unread:
        echo(recording.left_out, err=True)
    plan = plan_replay(
        recording,
        described.sensors,
        now=datetime.now(UTC),
        speed=speed,
        start=start,
        recorded_times=recorded_times,
    )
    _announce(thermap, machine, file, plan)
    _send(thermap, machine, plan)
    _show_change(thermap, machine, plan)


def _announce(thermap: ThermapClient, machine: str, file: Path, plan: Plan) -> None:
    first, last = plan.readings[0].time, plan.readings[-1].time
    reason = f": {plan.reason}" if plan.reason else ""
    echo(f"{file}: {counted(len(plan.readings), 'reading')} {plan.stamps}{reason}", err=True)
    if plan.stamps is not Stamps.AS_SENT:
        echo(f"from {first:%Y-%m-%d %H:%M:%S} to {last:%Y-%m-%d %H:%M:%S} UTC", err=True)
    if thermap.readings(machine, since=first - _JUMP_WITHIN, limit=1):
        echo(
            f"note: {machine} has other readings from about that time on; where they differ, "
            "its sensors will seem to jump and there is no live table",
            err=True,
        )


def _send(thermap: ThermapClient, machine: str, plan: Plan) -> None:
    """Send each reading when it is due; those that are due together go together."""
    sent = stored = 0
    began = time.monotonic()
    try:
        with progress_bar(MofNCompleteColumn(), TimeRemainingColumn()) as progress:
            task = progress.add_task("sending", total=len(plan.readings))
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
        echo(f"stopped after {sent} of {counted(len(plan.readings), 'reading')}", err=True)
        raise typer.Exit(130) from None
    echo(f"{counted(stored, 'reading')} stored, {sent - stored} there already")


def _show_change(thermap: ThermapClient, machine: str, plan: Plan) -> None:
    terminal = console()
    tables = sampled_tables(thermap, machine, plan.readings)
    if tables:
        terminal.print(change_view(component_changes(tables)))
    else:
        terminal.print("no reading of these has a compensation table")
    try:
        tagged = thermap.current_table(machine)
    except ConflictError as error:
        terminal.print(f"no live table: {error.detail}")
        return
    assert tagged is not None  # without an ETag there is always a table
    table = tagged.table
    newer = table.reading_time > plan.readings[-1].time + timedelta(milliseconds=1)
    terminal.print(
        f"live table: {'a newer reading' if newer else 'the last reading'} of "
        f"{table.reading_time:%Y-%m-%d %H:%M:%S} UTC, {table.reading_age_s:.0f} s old, "
        f"{'complete' if table.complete else 'not complete'}"
    )
    for warning in table.warnings:
        terminal.print(f"! {warning}", style="yellow")


def _checked_sensors(machine: MachineAnswer, columns: Mapping[str, str]) -> list[str]:
    """Name the machine's sensors; a column of any other is wrong usage."""
    sensors = [sensor.name for sensor in machine.sensors]
    sensors_named = {meaning for meaning in columns.values() if not is_state(meaning)}
    unknown = sorted(sensors_named - {*sensors, *TIME_COLUMNS})
    if unknown:
        raise typer.BadParameter(
            f"machine {machine.id!r} has no sensor {list_names(unknown)}; "
            f"it has {list_names(sensors)}",
            param_hint="--column",
        )
    return sensors


class Stamps(StrEnum):
    """Which times the readings are given."""

    AS_SENT = "stamped as they are sent"
    MOVED = "with their recorded spacing, the last one as it is sent"
    RECORDED = "with their recorded times"


@dataclass(frozen=True, slots=True)
class Plan:
    """What is sent when: seconds after the beginning [s], and the reading."""

    due_s: list[float]
    readings: list[ReadingSchema]
    stamps: Stamps
    reason: str = ""


def plan_replay(
    recording: Recording,
    sensors: Sequence[SensorSchema],
    *,
    now: datetime,
    speed: float,
    start: datetime | None,
    recorded_times: bool,
) -> Plan:
    """Decide when each reading is sent, and with which time.

    Parameters
    ----------
    sensors
        The machine's, with the fastest change that each can have.
    speed
        How many times faster than recorded; 0: all at once.
    start
        When a recording without dates began.
    recorded_times
        Whether readings keep the times of the recording where they could be stamped
        as they are sent.
    """
    zero_s = recording.times_s[0]
    due_s = [(t - zero_s) / speed if speed else 0.0 for t in recording.times_s]
    stamps, reason = _choose_stamps(recording, sensors, speed, start, recorded_times)
    if stamps is Stamps.AS_SENT:
        times = [now + timedelta(seconds=due) for due in due_s]
    else:
        # Sent slower than recorded, all but the first would be in the future.
        end = now + timedelta(seconds=due_s[-1]) if speed >= 1.0 else now
        origin = _origin(recording, stamps, end, start)
        times = [origin + timedelta(seconds=t - zero_s) for t in recording.times_s]
    readings = [
        ReadingSchema(time=time, temperatures_c=dict(temperatures_c), state=dict(state))
        for time, temperatures_c, state in zip(
            times, recording.temperatures_c, recording.states, strict=True
        )
    ]
    return Plan(due_s, readings, stamps, reason)


def _choose_stamps(
    recording: Recording,
    sensors: Sequence[SensorSchema],
    speed: float,
    start: datetime | None,
    recorded_times: bool,
) -> tuple[Stamps, str]:
    as_recorded = Stamps.RECORDED if recording.is_dated or start else Stamps.MOVED
    if recorded_times or start or speed == 0.0:
        return as_recorded, ""
    spacing_s = kept_spacing_s(Sensor(**sensor.model_dump()) for sensor in sensors)
    for sensor in sensors:
        if _seems_to_jump(recording, sensor, speed, spacing_s):
            return Stamps.MOVED, (
                f"at {speed:g} times the recorded speed {sensor.name} would seem to jump "
                f"(more than {sensor.max_rate_c_per_min:g} °C/min)"
            )
    return Stamps.AS_SENT, ""


def _origin(
    recording: Recording, stamps: Stamps, end: datetime, start: datetime | None
) -> datetime:
    """Time of the first reading; `end` is when the last one is sent."""
    if stamps is Stamps.MOVED:
        return end - timedelta(seconds=recording.duration_s)
    if recording.is_dated:
        return datetime.fromtimestamp(recording.times_s[0], UTC)
    assert start is not None  # without dates, only a stated start gives recorded times
    return start + timedelta(seconds=recording.times_s[0])


def _seems_to_jump(
    recording: Recording, sensor: SensorSchema, speed: float, spacing_s: float
) -> bool:
    """Whether a sensor's change, so much faster, is more than the service believes.

    Of readings that come closer than `spacing_s` the service keeps only some.
    """
    allowance_c = CLEARLY * sensor.resolution_c
    rate_c_per_s = sensor.max_rate_c_per_min / SECONDS_PER_MIN
    recorded = [
        (time_s / speed, values[sensor.name])
        for time_s, values in zip(recording.times_s, recording.temperatures_c, strict=True)
        if sensor.name in values
    ]
    kept_s, kept_c = recorded[0] if recorded else (0.0, 0.0)
    for time_s, value_c in recorded:
        if abs(value_c - kept_c) > allowance_c + rate_c_per_s * (time_s - kept_s):
            return True
        if time_s - kept_s >= spacing_s:
            kept_s, kept_c = time_s, value_c
    return False


@dataclass(frozen=True, slots=True)
class ComponentChange:
    """One component's compensation at the position where first and last differ most.

    `largest` is the greatest magnitude of change against the first table at any
    position of any table; all numbers in the component's unit.
    """

    code: str
    chapter: str
    unit: str
    position_mm: float | None
    first: float
    last: float
    largest: float


def sampled_tables(
    thermap: ThermapClient, machine: str, readings: Sequence[ReadingSchema]
) -> list[CompensationAnswer]:
    """Ask for the tables at evenly chosen readings, both ends among them.

    Readings that have no table, because a sensor is missing, are passed over.
    """
    tables = []
    for i in evenly_chosen(len(readings), SAMPLES):
        reading = readings[i]
        try:
            tables.append(thermap.compensation(machine, reading.temperatures_c, reading.state))
        except InvalidContentError:
            continue
    return tables


def component_changes(tables: Sequence[CompensationAnswer]) -> list[ComponentChange]:
    """Compare the first table with the last one, and with all between."""
    values = [_compensation_by_code(table) for table in tables]
    changes = []
    for entry in tables[0].components:
        code = entry.component
        series = [v[code] for v in values if code in v and v[code].shape == values[0][code].shape]
        over_time = np.array(series)
        most = int(np.abs(over_time[-1] - over_time[0]).argmax())
        changes.append(
            ComponentChange(
                code=code,
                chapter=entry.chapter,
                unit=entry.unit,
                position_mm=entry.positions_mm[most] if entry.positions_mm else None,
                first=float(over_time[0, most]),
                last=float(over_time[-1, most]),
                largest=float(np.abs(over_time - over_time[0]).max()),
            )
        )
    return changes


def change_view(changes: Iterable[ComponentChange]) -> RenderableType:
    """Lay the changes out for a terminal."""
    table = listing(
        *("component", "", "unit", "at mm", "first", "last", "change", "largest change"),
        right="lllRRRRR",
    )
    for c in changes:
        position = "" if c.position_mm is None else f"{c.position_mm:g}"
        numbers = (signed(c.first), signed(c.last), signed(c.last - c.first), f"{c.largest:.2f}")
        table.add_row(c.code, c.chapter, c.unit, position, *numbers)
    title = "Compensation at the first and the last reading, where they differ most"
    return Group(Text(title, style="bold"), table)


def _compensation_by_code(table: CompensationAnswer) -> dict[str, FloatArray]:
    """Every component's compensation, shape (n,), in its unit."""
    return {e.component: np.atleast_1d(e.to_numpy().compensation) for e in table.components}
