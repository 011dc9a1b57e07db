"""thermap simulate: what an instrument would read on a stored machine; machines with effects."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from app.cli.options import (
    LabelOption,
    MachineArgument,
    MissingOption,
    SeedOption,
    TemperatureOption,
    ToolOption,
    UrlOption,
    command_group,
    connect,
    field_question,
    label_of,
    read_point,
    write_file,
)
from app.cli.simulate_campaign import simulate_campaign
from app.cli.simulate_thermal_drift import simulate_thermal_drift
from app.cli.simulate_verification import simulate_verification
from app.cli.terminal import echo
from app.decimal_text import read_number
from app.errors import counted, list_names
from app.geometry.body_diagonal import DIAGONALS
from app.measurement.step_diagonal_readings import TARGETS
from thermap import DEFAULT_URL
from thermap.answers import SimulatedStepDiagonal

_DECIMALS = 6
"""Of readings in µm: far below what any laser resolves."""

simulate = command_group()


@simulate.callback()
def _describe() -> None:
    """Simulated readings on a stored machine, or a whole machine with an undeclared effect."""


simulate.command("verification")(simulate_verification)
simulate.command("campaign")(simulate_campaign)
simulate.command("thermal-drift")(simulate_thermal_drift)


@simulate.command("step-diagonal")
def simulate_step_diagonal(
    machine: MachineArgument,
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="CSV, as `thermap import --method step-diagonal` reads it.",
        ),
    ],
    temperature: TemperatureOption = None,
    tool: ToolOption = "0,0,0",
    steps: Annotated[int, typer.Option(min=1, help="Steps of each axis.")] = 10,
    origin: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Lowest corner of the volume in mm; that of the axes' travel if not stated.",
        ),
    ] = None,
    step: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Length of each axis' step in mm; over the whole travel if not stated.",
        ),
    ] = None,
    noise: Annotated[
        float,
        typer.Option(metavar="UM", min=0.0, help="Standard deviation of one reading in µm."),
    ] = 0.0,
    resolution: Annotated[
        float | None,
        typer.Option(
            metavar="UM", min=0.0, help="Readings are rounded to multiples of this, in µm."
        ),
    ] = None,
    seed: SeedOption = 0,
    target: Annotated[str, typer.Option(help="What reflects: point or flat-mirror.")] = "point",
    mirror_tilt: Annotated[
        list[str] | None,
        typer.Option(
            envvar="THERMAP_MIRROR_TILTS",
            metavar="DIAGONAL=A,B",
            help="Two tilts of a diagonal's mirror in µrad, about the horizontal and the other "
            "direction beside the diagonal, such as ppp=100,0.",
        ),
    ] = None,
    label: LabelOption = None,
    missing_as_zero: MissingOption = False,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """Write what a laser would read on the four step diagonals of a stored machine.

    At these temperatures, or at the latest reading. `thermap import --method
    step-diagonal FILE --evaluate-only` shows what comes out of it.

    Example: `thermap simulate step-diagonal mcfv5050 --noise 0.2 -o laser.csv`
    """
    _expect_file_and_target(output, target)
    named = label_of(output, label)
    plan: dict[str, Any] = field_question(temperature, tool, missing_as_zero) | {
        "steps": steps,
        "noise_um": noise,
        "resolution_um": resolution,
        "seed": seed,
        "target": target,
        "mirror_tilts_urad": dict(_read_tilts(mirror_tilt or ())),
    }
    if origin is not None:
        plan["origin_mm"] = read_point(origin, "--origin", "0,0,0")
    if step is not None:
        plan["step_mm"] = read_point(step, "--step", "50,50,40")
    with connect(url) as thermap:
        simulated = thermap.simulate_step_diagonal(machine, plan)
    text = "".join(f"{line}\n" for line in step_diagonal_lines(simulated, plan, named, _now()))
    write_file(output, text)
    zero = (
        [f"counted as zero: {list_names(simulated.counted_as_zero)}"]
        if simulated.counted_as_zero
        else []
    )
    for warning in [*zero, *simulated.warnings]:
        echo(f"note: {warning}", err=True)
    walked = f"{counted(len(simulated.diagonals), 'diagonal')} in {counted(steps, 'step')}"
    echo(f"{output}: {walked}, simulated")


def step_diagonal_lines(
    simulated: SimulatedStepDiagonal, plan: dict[str, Any], label: str, measured_at: str
) -> Iterator[str]:
    """Write the lines of the file as docs/methods/files.md has them.

    Parameters
    ----------
    plan
        What it was asked, of which noise, resolution and tilts are told in a sentence.
    """
    yield f"# label: {label}"
    yield f"# machine: {simulated.machine}"
    yield f"# measured_at: {measured_at}"
    yield "# instrument: simulation"
    # Sentences without a colon are read by people alone.
    yield f"# Simulated from model version {simulated.model_version}, for training, not measured"
    yield f"# Simulated with {_disturbances(plan)}"
    if simulated.counted_as_zero:
        yield f"# No two maps have {list_names(simulated.counted_as_zero)}, which count as zero"
    for sensor, temperature_c in simulated.temperatures_c.items():
        yield f"# temperature {sensor}: {temperature_c!r}"
    yield f"# origin_mm: {_point(simulated.origin_mm)}"
    yield f"# step_mm: {_point(simulated.step_mm)}"
    yield f"# tool_offset_mm: {_point(simulated.tool_offset_mm)}"
    yield f"# target: {simulated.target}"
    yield "diagonal,step,after_x_um,after_y_um,after_z_um"
    for diagonal, rows in simulated.diagonals.items():
        for number, row in enumerate(rows, start=1):
            readings = ",".join(f"{reading:.{_DECIMALS}f}" for reading in row)
            yield f"{diagonal},{number},{readings}"


def _disturbances(plan: dict[str, Any]) -> str:
    """Say what the readings have beside the machine's errors."""
    parts = [f"noise of {plan['noise_um']:g} µm (seed {plan['seed']})" if plan["noise_um"] else ""]
    parts.append(f"steps of {plan['resolution_um']:g} µm" if plan["resolution_um"] else "")
    for diagonal, (first, second) in plan["mirror_tilts_urad"].items():
        parts.append(f"a mirror of {diagonal} tilted by {first:g} and {second:g} µrad")
    return ", ".join(filter(None, parts)) or "no noise"


def _point(numbers: Iterable[float]) -> str:
    return ", ".join(map(repr, numbers))


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


def _expect_file_and_target(output: Path, target: str) -> None:
    if output.suffix.lower() == ".json":
        raise typer.BadParameter(f"expected a CSV file, got {str(output)!r}", param_hint="--output")
    if target not in TARGETS:
        raise typer.BadParameter(
            f"expected one of {list_names(TARGETS)}, got {target!r}", param_hint="--target"
        )


def _read_tilts(texts: Iterable[str]) -> Iterator[tuple[str, list[float]]]:
    """Read `DIAGONAL=A,B` as often as it is stated."""
    met: set[str] = set()
    for text in texts:
        diagonal, _, written = text.partition("=")
        numbers = [read_number(part, decimal_comma=False) for part in written.split(",")]
        tilts = [number for number in numbers if number is not None]
        if diagonal not in DIAGONALS or diagonal in met or len(numbers) != 2 or len(tilts) != 2:
            raise typer.BadParameter(
                f"expected DIAGONAL=A,B once for each of {list_names(DIAGONALS)}, with two "
                f"angles in µrad such as ppp=100,0, got {text!r}",
                param_hint="--mirror-tilt",
            )
        met.add(diagonal)
        yield diagonal, tilts
