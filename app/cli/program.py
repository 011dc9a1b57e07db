"""thermap program: NC programs of measurements, and the empty files for what is read."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

import typer

from app.cli.asking import parameters_of, with_parameters
from app.cli.check_files import look_at_visits
from app.cli.controllers import write_files
from app.cli.options import (
    MachineArgument,
    Named,
    Numbers,
    UrlOption,
    by_name,
    command_group,
    connect,
    named_option,
    numbers,
    point_option,
    time_option,
)
from app.cli.terminal import echo
from app.decimal_text import read_number
from app.errors import counted, list_names
from app.measurement.positioning import RUNS_OF_THE_STANDARD
from app.programs.body_diagonal import RUNS, body_diagonal_program
from app.programs.dialects import DIALECTS, dialect_named
from app.programs.moving_axis import MotionStep, moving_axis_program
from app.programs.path import Manner
from app.programs.positioning import positioning_program
from app.programs.program import MeasuringProgram, Stop
from app.programs.step_diagonal import step_diagonal_program
from app.programs.visit import visit_program
from app.programs.warm_up import SpindleStep, warm_up_program
from app.thermal.machine import MACHINE, Machine
from app.units import SECONDS_PER_MIN
from thermap import DEFAULT_URL, calls

ControllerOption = Annotated[
    str,
    typer.Option(
        "--controller", "-c", metavar="NAME", help=f"Whose words: {list_names(DIALECTS)}."
    ),
]
OutputOption = Annotated[
    Path | None,
    typer.Option("--output", metavar="FOLDER", help="Folder into which both files are written."),
]
OverwriteOption = Annotated[
    bool, typer.Option("--overwrite", help="Replace files that are there already.")
]
FeedOption = Annotated[
    float, typer.Option("--feed", metavar="MM/MIN", help="Feed of all moves that do not cross.")
]
DwellOption = Annotated[
    float, typer.Option("--dwell", metavar="S", help="Standing still at each reading.")
]
ReadingOption = Annotated[
    float,
    typer.Option(
        "--reading", metavar="S", help="Time at rest that the instrument needs for a reading."
    ),
]
OverrunOption = Annotated[
    float,
    typer.Option("--overrun", metavar="MM", help="How far behind a position its approach begins."),
]
WindowOption = Annotated[
    float,
    typer.Option(
        "--window", metavar="MM", help="Tolerance of an instrument that triggers itself, ±."
    ),
]
_POSITIONS: Final = numbers("positions in mm such as 0,100,250.5")

RetractOption = Annotated[
    Named | None,
    named_option(
        "a position in mm",
        "Where an axis is out of the way; in this order. Default: z at its highest.",
        "--retract",
        metavar="AXIS=MM",
    ),
]
LineOption = Annotated[
    Named | None,
    named_option(
        "a position in mm",
        "Where another axis stands; the middle of its travel if not stated.",
        "--line",
        metavar="AXIS=MM",
    ),
]
StepsOption = Annotated[int, typer.Option("--steps", help="Steps of each axis.")]
OriginOption = Annotated[
    Numbers | None,
    point_option("Lowest corner in mm; that of the travel if not stated.", "--origin"),
]
StepOption = Annotated[
    Numbers | None,
    point_option("Each axis' step in mm; over the travel if not stated.", "--step"),
]

EveryOption = Annotated[
    float, typer.Option("--every", metavar="MIN", help="Pause between readings.")
]
StartOption = Annotated[
    datetime | None, time_option("--start", "Planned start, for the readings' times.")
]
AxisOption = Annotated[str, typer.Option("--axis", parser=str.lower, help="x, y or z.")]

_MANNER: Final = Manner()

Step = TypeVar("Step")

program = command_group()


def _steps(step: Callable[[float, float], Step], expected: str) -> Callable[[str], Step]:
    """Make what reads a speed and its minutes, `4000=60`; a speed may come twice."""

    def read(text: str) -> Step:
        speed, minutes = map(read_number, text.rpartition("=")[::2])
        if speed is None or minutes is None:
            raise typer.BadParameter(f"expected {expected}, got {text!r}")
        return step(speed, minutes)

    return read


@program.callback()
def _describe() -> None:
    """NC programs that move a machine through a measurement, and files for the readings.

    Inside the machine's stated travel, retracted where it crosses. Beside each program lies
    the empty file that its readings are filled into; thermap reads it back.
    """


def _writes(make: Callable[..., MeasuringProgram]) -> Callable[..., None]:
    """Make a command of what makes a program: all of them share how it is written and how moved.

    The command takes the options of `make`, but for its `machine` and `manner`, and those that
    `_machine_and_manner` and `_write` read.
    """
    method_options = [p for p in parameters_of(make) if p.name not in ("machine", "manner")]
    moved, written = parameters_of(_machine_and_manner), parameters_of(_write)[1:]

    def command(**stated: Any) -> None:
        values = by_name(stated)
        machine, manner = _machine_and_manner(**{p.name: values[p.name] for p in moved})
        measuring_program = make(
            machine, manner, **{p.name: values[p.name] for p in method_options}
        )
        _write(measuring_program, **{p.name: values[p.name] for p in written})

    (argument, *options) = moved
    named = {p.name for p in method_options}
    options = [p for p in options if p.name not in named]
    return with_parameters(command, make, [argument, *method_options, *written, *options])


def _machine_and_manner(
    machine: MachineArgument,
    feed: FeedOption = _MANNER.feed_mm_per_min,
    dwell: DwellOption = _MANNER.dwell_s,
    reading: ReadingOption = _MANNER.reading_s,
    overrun: OverrunOption = _MANNER.overrun_mm,
    window: WindowOption = _MANNER.window_mm,
    retract: RetractOption = None,
    url: UrlOption = DEFAULT_URL,
) -> tuple[Machine, Manner]:
    manner = Manner(feed, dwell, reading, overrun, window, retract or None)
    with connect(url) as thermap:
        content = thermap.content(calls.machine(machine))
    return MACHINE.validate_json(content, extra="ignore"), manner


def _write(
    measuring_program: MeasuringProgram,
    controller: ControllerOption,
    output: OutputOption = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Write both files, or none, and say what they are for."""
    dialect = dialect_named(controller)
    readings = f"{measuring_program.name}.csv"
    files = {
        f"{measuring_program.name}{dialect.suffix}": dialect.write(measuring_program),
        readings: measuring_program.readings.content,
    }
    if output is not None:
        write_files(output, files, overwrite=overwrite)
    stops = sum(isinstance(block, Stop) for block in measuring_program.blocks)
    echo(
        f"{measuring_program.title}, {measuring_program.machine}, for {dialect.title}: "
        f"{dialect.status}"
    )
    for sentence in (dialect.where, *measuring_program.head):
        echo(f"  {sentence}")
    echo(
        f"  takes {measuring_program.seconds / SECONDS_PER_MIN:.0f} min, rapid moves and "
        "acceleration not "
        f"counted, and waits {counted(stops, 'time')} for you"
    )
    for note in measuring_program.notes:
        echo(f"note: {note}", err=True)
    names = list_names(files)
    if output is None:
        echo(f"{names}: written nowhere: state --output FOLDER")
        return
    echo(f"{names}: written to {output}")
    command = measuring_program.readings.command.replace("FILE", str(output / readings))
    echo(f"fill in {readings}, then: {command}")


@program.command("positioning")
@_writes
def write_positioning(
    machine: Machine,
    manner: Manner,
    axis: AxisOption,
    targets: Annotated[
        int | None,
        typer.Option(
            "--targets", metavar="N", help="How many; default 11, or 5 per metre if more."
        ),
    ] = None,
    at: Annotated[
        Numbers | None,
        typer.Option(
            "--at",
            metavar="MM,MM,…",
            parser=_POSITIONS,
            help="These targets instead of chosen ones.",
        ),
    ] = None,
    runs: Annotated[int, typer.Option("--runs", help="In each direction.")] = RUNS_OF_THE_STANDARD,
    line: LineOption = None,
    seed: Annotated[
        int,
        typer.Option("--seed", min=0, help="Of the targets' random offsets."),
    ] = 0,
) -> MeasuringProgram:
    """Positioning of an axis by ISO 230-2: targets with a random offset, runs both ways.

    Example: `thermap program positioning mcfv5050 --axis x -c siemens --output posx`
    """
    if at is not None and targets is not None:
        raise typer.BadParameter("expected --at or --targets, got both", param_hint="--at")
    return positioning_program(
        machine,
        manner,
        axis,
        targets_mm=at,
        count=targets,
        runs=runs,
        line_mm=line,
        seed=seed,
    )


@program.command("step-diagonal")
@_writes
def write_step_diagonal(
    machine: Machine,
    manner: Manner,
    steps: StepsOption = 10,
    origin: OriginOption = None,
    step: StepOption = None,
) -> MeasuringProgram:
    """Sequential step diagonals: x, then y, then z, along each of the four body diagonals.

    Example: `thermap program step-diagonal mcfv5050 -c heidenhain --output diagonals`
    """
    return step_diagonal_program(
        machine,
        manner,
        steps=steps,
        origin_mm=origin,
        step_mm=step,
    )


@program.command("body-diagonal")
@_writes
def write_body_diagonal(
    machine: Machine,
    manner: Manner,
    steps: StepsOption = 10,
    runs: Annotated[int, typer.Option("--runs", help="There and back, of each diagonal.")] = RUNS,
    origin: OriginOption = None,
    step: StepOption = None,
) -> MeasuringProgram:
    """Body diagonals by ISO 230-6: all axes together, there and back.

    Example: `thermap program body-diagonal mcfv5050 -c fanuc --output diagonals`
    """
    return body_diagonal_program(
        machine,
        manner,
        steps=steps,
        runs=runs,
        origin_mm=origin,
        step_mm=step,
    )


@program.command("warm-up")
@_writes
def write_warm_up(
    machine: Machine,
    manner: Manner,
    spindle: Annotated[
        list[Any],
        typer.Option(
            "--spindle",
            metavar="RPM=MIN",
            parser=_steps(SpindleStep, "RPM=MIN such as 4000=60"),
            help="A spindle step; in this order.",
        ),
    ],
    place: Annotated[
        list[Any],
        point_option("A measuring position; once for each.", "--place", such_as="250,200,100"),
    ],
    cooling: Annotated[
        float, typer.Option("--cooling", metavar="MIN", help="With the spindle stopped, after it.")
    ] = 60.0,
    every: EveryOption = 5.0,
    spin_down: Annotated[
        float, typer.Option("--spin-down", metavar="S", help="Until the spindle stands.")
    ] = 15.0,
    in_place: Annotated[
        bool,
        typer.Option(
            "--in-place",
            help="Stay at the measuring position and read while the spindle turns: for sensors "
            "without contact.",
        ),
    ] = False,
    sensor_distance: Annotated[
        float | None,
        typer.Option(
            "--sensor-distance",
            metavar="MM",
            help="How much further along z a second pair of sensors reads x and y.",
        ),
    ] = None,
    start: StartOption = None,
) -> MeasuringProgram:
    """Warming up and cooling down by ISO 230-3: spindle steps, and returns to be measured.

    Example: `thermap program warm-up mcfv5050 -c linuxcnc --spindle 4000=60 --spindle 8000=60
    --cooling 90 --place 250,200,100 --output warm-up`
    """
    steps = [*spindle, *([SpindleStep(0.0, cooling)] if cooling else [])]
    return warm_up_program(
        machine,
        manner,
        steps,
        place,
        every_min=every,
        spin_down_s=spin_down,
        in_place=in_place,
        sensor_distance_mm=sensor_distance,
        start_s=None if start is None else start.timestamp(),
    )


@program.command("moving-axis")
@_writes
def write_moving_axis(
    machine: Machine,
    manner: Manner,
    axis: AxisOption,
    moving: Annotated[
        list[Any],
        typer.Option(
            "--moving",
            metavar="MM/MIN=MIN",
            parser=_steps(MotionStep, "MM/MIN=MIN such as 15000=60"),
            help="Back and forth at a feed; in this order.",
        ),
    ],
    cooling: Annotated[
        float, typer.Option("--cooling", metavar="MIN", help="Standing still, after it.")
    ] = 60.0,
    every: EveryOption = 5.0,
    begin: Annotated[
        float | None,
        typer.Option(
            "--from", metavar="MM", help="Lowest position; the travel less the overrun otherwise."
        ),
    ] = None,
    end: Annotated[
        float | None, typer.Option("--to", metavar="MM", help="Highest position; likewise.")
    ] = None,
    at: Annotated[
        Numbers | None,
        typer.Option(
            "--at",
            metavar="MM,MM,…",
            parser=_POSITIONS,
            help="Where it is read; the ends of the motion and its middle otherwise.",
        ),
    ] = None,
    line: LineOption = None,
    start: StartOption = None,
) -> MeasuringProgram:
    """Warming up by a moving axis, by ISO 230-3: back and forth, and stopped to be measured.

    Example: `thermap program moving-axis mcfv5050 -c siemens --axis x --moving 15000=60
    --cooling 90 --from 50 --to 450 --output x-warm`
    """
    steps = [*moving, *([MotionStep(0.0, cooling)] if cooling else [])]
    return moving_axis_program(
        machine,
        manner,
        axis,
        steps,
        between_mm=(begin, end),
        targets_mm=at,
        every_min=every,
        line_mm=line,
        start_s=None if start is None else start.timestamp(),
    )


@program.command("visit")
@_writes
def write_visit(
    machine: Machine,
    manner: Manner,
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="The observations, as `thermap analyse --plan` has."),
    ],
    line: LineOption = None,
    url: UrlOption = DEFAULT_URL,
) -> MeasuringProgram:
    """Write a planned visit: its observations in order of time, each approached as stated.

    Example: `thermap program visit mcfv5050 planned.csv -c siemens --output monday`
    """
    with connect(url) as thermap:
        (visit,) = look_at_visits(thermap, machine.id, [file])
    return visit_program(
        machine,
        manner,
        visit.planned.to_verification(),
        line_mm=line,
    )
