"""thermap hal: the live compensation in LinuxCNC."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

import typer

import app as package
from app.cli.options import MachineArgument, UrlOption, command_group, connect, write_file
from app.cli.terminal import echo, write_document
from app.errors import ThermapError, list_names
from app.hal.curves import (
    AXES,
    SQUARENESS,
    Nodes,
    curves_between,
    halves_told,
    largest_half,
    nodes_of,
)
from app.hal.wiring import NotWired, sensor_pin, wiring
from thermap import DEFAULT_URL

if TYPE_CHECKING:
    from thermap.answers import ErrorMapAnswer, MachineAnswer

LINUXCNC_PYTHON: Final = "/usr/bin/python3"
MM_PER_INCH: Final = 25.4
LAST_JOINT: Final = 15

START: Final = (
    "import sys; sys.path.append(sys.argv[1]); "
    "from app.hal.component import main; main(sys.argv[2:])"
)
"""Our folder comes last: LinuxCNC's Python shall find none of our libraries before its own."""

RateOption = Annotated[
    float,
    typer.Option(
        "--rate",
        metavar="µM/S",
        min=0.01,
        max=1000,
        help="How fast the compensation moves an axis at most, in µm/s.",
    ),
]
PeriodOption = Annotated[
    float,
    typer.Option(
        "--period",
        metavar="S",
        min=0.005,
        max=1,
        help="Time between two steps; each is at most the rate times this.",
    ),
]
EveryOption = Annotated[
    float,
    typer.Option(
        "--every",
        metavar="S",
        min=0.1,
        max=3600,
        help="How often readings are sent and the table is asked for; three times without an "
        "answer are stale.",
    ),
]
LimitOption = Annotated[
    float,
    typer.Option(
        "--limit",
        metavar="µM",
        min=1,
        max=10_000,
        help="A table that would move an axis further is not followed.",
    ),
]
UnitsOption = Annotated[
    Literal["mm", "inch"], typer.Option("--units", help="LINEAR_UNITS of the machine.")
]
JointsOption = Annotated[
    str | None,
    typer.Option(
        "--joints",
        metavar="N,N,N",
        help="Numbers of the joints of X, Y and Z, of a lathe those of X and Z: of the linear axes "
        "that the machine has. Joints that move an axis together, as of a gantry, are joined by +: "
        "0,1+2,3.",
        show_default="0,1,2 or 0,1",
    ),
]
PythonOption = Annotated[
    str,
    typer.Option("--python", metavar="FILE", help="LinuxCNC's Python, which has its module hal."),
]

hal = command_group()


class NotStarted(ThermapError):
    """The component could not be started."""


@hal.command("wiring")
def write_wiring(
    machine: MachineArgument,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE.hal", help="Write it to a file."),
    ] = None,
    rate: RateOption = 5.0,
    period: PeriodOption = 0.02,
    every: EveryOption = 10.0,
    limit: LimitOption = 500.0,
    units: UnitsOption = "mm",
    joints: JointsOption = None,
    python: PythonOption = LINUXCNC_PYTHON,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """Write the HAL file of a machine: curves, sums and offsets, and the line that starts `follow`.

    Its points are the positions of the maps where 16 an axis are enough, else an even grid; write
    it again when maps at other positions are in use.

    Example: `thermap hal wiring mcfv5050 --output thermap.hal`
    """
    with connect(url) as thermap:
        stored = thermap.machine(machine)
        maps = thermap.error_maps(machine)
    nodes = _nodes(stored, maps)
    numbers = _joints(joints, len(nodes))
    if len(numbers) != len(nodes):
        raise typer.BadParameter(
            f"expected a joint for each of {list_names([axis.upper() for axis in nodes])}, those "
            f"of a gantry's axis joined by + (0,1+2,3), got {joints!r}",
            param_hint="--joints",
        )
    sensors = [sensor.name for sensor in stored.sensors]
    command = [
        # Whatever the PATH is where LinuxCNC is started.
        *(sys.executable, "-m", "app", "hal", "follow", machine),
        *("--url", url, "--rate", f"{rate:g}", "--period", f"{period:g}"),
        *("--every", f"{every:g}", "--limit", f"{limit:g}", "--units", units),
        *("--python", python),
        *("--joints", ",".join("+".join(map(str, of_axis)) for of_axis in numbers)),
        *(("--sensors", ",".join(sensors)) if sensors else ()),
    ]
    per_mm = 1.0 if units == "mm" else 1.0 / MM_PER_INCH
    try:
        for sensor in sensors:
            sensor_pin(sensor)
        text = wiring(nodes, dict(zip(nodes, numbers, strict=True)), per_mm, command)
    except NotWired as error:
        raise NotStarted(str(error)) from None
    if output is None:
        write_document(text)
    else:
        write_file(output, text)
    if lacking := _not_in_curves(maps, nodes):
        echo(f"note: not in HAL's curves: {list_names(lacking)}", err=True)


@hal.command("follow")
def follow(
    machine: MachineArgument,
    sensors: Annotated[
        str,
        typer.Option("--sensors", metavar="NAME,NAME", help="Sensors that have a pin each."),
    ] = "",
    rate: RateOption = 5.0,
    period: PeriodOption = 0.02,
    every: EveryOption = 10.0,
    limit: LimitOption = 500.0,
    units: UnitsOption = "mm",
    joints: JointsOption = None,
    python: PythonOption = LINUXCNC_PYTHON,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """Run the HAL component that follows the table; the HAL file of `wiring` starts it.

    Example: `loadusr -Wn thermap thermap hal follow mcfv5050 --sensors x-middle,z-column`
    """
    named = [name for name in sensors.split(",") if name]
    try:
        for name in named:
            sensor_pin(name)
    except NotWired as error:
        raise typer.BadParameter(str(error), param_hint="--sensors") from None
    root = str(Path(package.__file__).parent.parent)
    words = [
        *(machine, "--url", url, "--units", units),
        *("--every-s", str(every), "--period-s", str(period)),
        *("--rate-um-per-s", str(rate), "--limit-um", str(limit)),
        *(word for name in named for word in ("--sensor", name)),
        *(word for number in chain(*_joints(joints)) for word in ("--joint", str(number))),
    ]
    try:
        # In its place, so that HAL waits for this process and ends it.
        os.execv(python, [python, "-c", START, root, *words])
    except OSError as error:
        raise NotStarted(f"cannot run {python}: {error.strerror}") from None


def _joints(text: str | None, axes: int = len(AXES)) -> list[list[int]]:
    """Read the joints of each axis, as `0,1+2,3`."""
    if text is None:
        return [[number] for number in range(axes)]
    of_axes = [[word.strip() for word in axis.split("+")] for axis in text.split(",")]
    words = [*chain(*of_axes)]
    if len(set(words)) != len(words) or not all(map(_is_joint, words)):
        raise typer.BadParameter(
            f"expected different joints, each 0 to {LAST_JOINT}, such as 0,1,2, or 0,1+2,3 where "
            f"two move an axis together, got {text!r}",
            param_hint="--joints",
        )
    return [[int(word) for word in axis] for axis in of_axes]


def _is_joint(word: str) -> bool:
    return word in map(str, range(LAST_JOINT + 1))


def _nodes(machine: MachineAnswer, maps: Sequence[ErrorMapAnswer]) -> Nodes:
    """Choose each axis' nodes from its maps and its travel."""
    axes = [axis for axis in AXES if axis.upper() in machine.configuration]
    missing = [axis.upper() for axis in axes if axis not in machine.axes]
    if missing:
        raise NotStarted(
            f"expected the travel of all axes of {machine.configuration}, got none of "
            f"{list_names(missing)}"
        )
    curves = curves_between(axes)
    travels = [machine.axes[axis] for axis in axes]
    return {
        axis: nodes_of(
            (travel.min_mm, travel.max_mm),
            [
                position
                for error_map in maps
                for row in error_map.components
                if row.component in curves and curves[row.component][1] == axis
                for position in row.positions_mm or ()
            ],
        )
        for axis, travel in zip(axes, travels, strict=True)
    }


def _not_in_curves(maps: Sequence[ErrorMapAnswer], axes: Iterable[str]) -> list[str]:
    """Say what of the maps the motors will not follow."""
    curves = curves_between(axes)
    rows = [row for error_map in maps for row in error_map.components]
    halves: dict[str, float] = {}
    for row in rows:
        if row.component in curves and row.errors_um and row.backward_errors_um:
            half_um = largest_half(row.errors_um, row.backward_errors_um)
            halves[row.component] = max(half_um, halves.get(row.component, 0.0))
    others = dict.fromkeys(row.component for row in rows)
    return [
        *halves_told(halves),
        *(code for code in others if code not in curves and SQUARENESS.get(code) not in curves),
    ]
