"""thermap simulate thermal-drift: what a nest of displacement sensors would read over hours.

The model's error at the nest at the times of stored readings, with their temperatures and states,
and noise. With `--growth` the tool drifts as the model does not know, for `thermap analyse` to
find.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from app.cli.asking import ThermapClient, asks
from app.cli.options import (
    NO_OFFSET,
    LabelOption,
    MachineArgument,
    MissingOption,
    Named,
    Numbers,
    SeedOption,
    ToolOption,
    label_of,
    named_option,
    point_option,
    time_option,
    write_file,
)
from app.cli.simulate_verification import NothingToSimulate
from app.cli.terminal import echo
from app.csv_text import csv_line, no_formula
from app.errors import counted, list_names
from app.geometry.components import LINEAR_LETTERS
from app.measurement.thermal_drift_readings import SENSORS, DriftTest
from app.units import SECONDS_PER_H, SECONDS_PER_MIN

if TYPE_CHECKING:
    from thermap.answers import ReadingSchema

_DECIMALS: Final = 4
_SINGLE: Final = (("x", 0, 0), ("y", 0, 1), ("z", 0, 2))
_DOUBLE: Final = (("x2", 1, 0), ("y2", 1, 1))
"""Sensor, the height at which it reads, and the direction."""


@dataclass(frozen=True, slots=True)
class _Row:
    """A stored reading, where the moving axis stood, and what each sensor would read [µm]."""

    reading: ReadingSchema
    target_mm: float | None
    values: Mapping[str, float]


@asks
def simulate_thermal_drift(
    thermap: ThermapClient,
    machine: MachineArgument,
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="CSV, as `thermap import --method thermal-drift` reads it.",
        ),
    ],
    point: Annotated[
        Numbers,
        point_option(
            "Where the machine stands while the nest is read, in mm.", such_as="250,200,300"
        ),
    ],
    tool: ToolOption = NO_OFFSET,
    test: Annotated[
        DriftTest, typer.Option(envvar="THERMAP_DRIFT_TEST", help="What is tested.")
    ] = DriftTest.SPINDLE,
    axis: Annotated[
        str | None,
        typer.Option(help="The moving axis of the test linear-axis."),
    ] = None,
    target: Annotated[
        list[float] | None,
        typer.Option(
            envvar="THERMAP_TARGETS",
            metavar="MM",
            help="A position at which the moving axis is read in turn; two or more.",
        ),
    ] = None,
    sensor_distance: Annotated[
        float | None,
        typer.Option(
            metavar="MM", help="Five sensors: so far along Z the second ones of X and Y read."
        ),
    ] = None,
    since: Annotated[datetime | None, time_option("--from", "When the test begins.")] = None,
    hours: Annotated[float, typer.Option(min=0.1, help="How long it lasts, at most.")] = 8.0,
    every: Annotated[float, typer.Option(min=0.0, help="Minutes between two readings.")] = 2.0,
    growth: Annotated[
        Named | None,
        named_option(
            "a growth in µm",
            "A drift that the model lacks, such as z=12: reached with --growth-min.",
            metavar="AXIS=UM",
            envvar="THERMAP_GROWTHS",
        ),
    ] = None,
    growth_min: Annotated[
        float,
        typer.Option(min=0.1, help="Time constant of that drift in minutes."),
    ] = 40.0,
    noise: Annotated[
        float,
        typer.Option(metavar="UM", min=0.0, help="Standard deviation of one reading in µm."),
    ] = 0.2,
    seed: SeedOption = 0,
    label: LabelOption = None,
    missing_as_zero: MissingOption = False,
) -> None:
    """Write what a nest of three or five displacement sensors would read on a stored machine.

    At the times of its stored readings, whose temperatures and states stand beside. `thermap
    import --method thermal-drift FILE --evaluate-only` shows what comes out of it.

    Example: `thermap simulate thermal-drift vmc --point 250,200,300 --growth z=12 -o warm-up.csv`
    """
    import numpy as np

    named = label_of(output, label)
    _expect_test(test, axis, target)
    grown = {name.lower(): value for name, value in (growth or {}).items()}
    if unknown := [name for name in grown if name not in LINEAR_LETTERS]:
        raise typer.BadParameter(
            f"expected x, y or z, got {list_names(unknown)}", param_hint="--growth"
        )
    heights = [tool]
    if sensor_distance is not None:
        x, y, z = heights[0]
        heights.append([x, y, z + sensor_distance])
    places = _places(point, axis, target)
    readings = _readings(thermap, machine, since, timedelta(hours=hours), every)
    rows = list(_predicted(thermap, machine, readings, places, heights, missing_as_zero))
    if len(rows) < 2:
        raise NothingToSimulate(
            f"the model says nothing of machine {machine!r} at two of these times: there are no "
            "readings, or no two error maps"
        )
    rng = np.random.default_rng(seed)
    sensors = [name for name in SENSORS if name in rows[0].values]
    first: dict[float | None, Mapping[str, float]] = {}
    values: list[list[float]] = []
    for row in rows:
        zero = first.setdefault(row.target_mm, row.values)
        minutes = (row.reading.time - rows[0].reading.time) / timedelta(minutes=1)
        share = 1.0 - math.exp(-minutes / growth_min)
        read = [row.values[s] - zero[s] + grown.get(s[0], 0.0) * share for s in sensors]
        values.append([float(v) for v in np.array(read) + rng.normal(0.0, noise, len(read))])
    head = [f"label: {named}", f"machine: {machine}", "instrument: simulation", f"test: {test}"]
    head += [f"axis: {axis}"] if axis else []
    head += [
        f"{name}: {', '.join(map(repr, place))}"
        for name, place in (("point_mm", point), ("tool_offset_mm", tool))
    ]
    head += [] if sensor_distance is None else [f"sensor_distance_mm: {sensor_distance:g}"]
    # Sentences without a colon are read by people alone.
    head.append(f"Simulated for training, not measured, with noise of {noise:g} µm (seed {seed})")
    head += [
        f"The model lacks {value:g} µm in {name} with a time constant of {growth_min:g} min"
        for name, value in grown.items()
    ]
    write_file(output, _written(head, sensors, rows, values))
    lasting = (rows[-1].reading.time - rows[0].reading.time) / timedelta(hours=1)
    echo(f"{output}: {counted(len(rows), 'reading')} over {lasting:.3g} h, simulated")


def _expect_test(test: DriftTest, axis: str | None, targets: Sequence[float] | None) -> None:
    moves = test == DriftTest.LINEAR_AXIS
    if moves != (axis in tuple(LINEAR_LETTERS)) or moves != bool(targets):
        raise typer.BadParameter(
            "expected --axis x, y or z and --target of the test linear-axis, and of no other",
            param_hint="--axis",
        )


def _places(
    point: Sequence[float], axis: str | None, targets: Sequence[float] | None
) -> list[tuple[float | None, list[float]]]:
    """List where the machine stands in turn, with the target of the moving axis."""
    if axis is None:
        return [(None, list(point))]
    at = LINEAR_LETTERS.index(axis)
    return [(t, [t if i == at else p for i, p in enumerate(point)]) for t in targets or ()]


def _readings(
    thermap: ThermapClient,
    machine: str,
    since: datetime | None,
    lasting: timedelta,
    every_min: float,
) -> list[ReadingSchema]:
    """Take the stored readings of the test's time: from its beginning, or the latest."""
    every_s = every_min * SECONDS_PER_MIN or None
    if since is None:
        hourly = thermap.readings(machine, every_s=SECONDS_PER_H)
        if not hourly:
            return []
        latest = thermap.readings(machine, hourly[-1].time)[-1].time
        since = latest - lasting
    return list(thermap.readings(machine, since, since + lasting, every_s=every_s))


def _predicted(
    thermap: ThermapClient,
    machine: str,
    readings: Sequence[ReadingSchema],
    places: Sequence[tuple[float | None, list[float]]],
    heights: Sequence[Sequence[float]],
    missing_as_zero: bool,
) -> Iterator[_Row]:
    """Ask the model for the error at the nest; a time at which it has none is left out."""
    questions: list[dict[str, Any]] = []
    for i, reading in enumerate(readings):
        _, place = places[i % len(places)]
        questions += [
            {"time": _time(reading), "point_mm": place, "tool_offset_mm": height}
            for height in heights
        ]
    if not questions:
        return
    missing = "zero" if missing_as_zero else "refuse"
    predicted_um = thermap.predict(machine, questions, missing_components=missing).predicted_um
    sensors = _SINGLE + (_DOUBLE if len(heights) > 1 else ())
    for i, reading in enumerate(readings):
        errors = predicted_um[i * len(heights) : (i + 1) * len(heights)]
        if any(not isinstance(error, Sequence) for error in errors):
            continue
        read: Any = errors
        values = {name: float(read[height][along]) for name, height, along in sensors}
        yield _Row(reading, places[i % len(places)][0], values)


def _written(
    head: Sequence[str],
    sensors: Sequence[str],
    rows: Sequence[_Row],
    values: Sequence[Sequence[float]],
) -> str:
    moves = rows[0].target_mm is not None
    temperatures = list(dict.fromkeys(n for row in rows for n in row.reading.temperatures_c))
    states = list(dict.fromkeys(n for row in rows for n in row.reading.state))
    columns = [
        "time",
        *(["position_mm"] if moves else []),
        *(f"{sensor}_um" for sensor in sensors),
        *(f"temperature {name}" for name in temperatures),
        *(f"state {name}" for name in states),
    ]
    lines = [*(f"# {no_formula(line)}\n" for line in head), csv_line(columns)]
    for row, read in zip(rows, values, strict=True):
        reading = row.reading
        cells = [
            _time(reading),
            *([repr(row.target_mm)] if moves else []),
            *(f"{value:.{_DECIMALS}f}" for value in read),
            *(_cell(reading.temperatures_c.get(name)) for name in temperatures),
            *(_cell(reading.state.get(name)) for name in states),
        ]
        lines.append(csv_line(cells))
    return "".join(lines)


def _time(reading: ReadingSchema) -> str:
    return reading.time.isoformat().replace("+00:00", "Z")


def _cell(value: float | None) -> str:
    return "" if value is None else repr(value)
