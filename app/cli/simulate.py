"""thermap simulate: what an instrument would read on a stored machine; machines with effects."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

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
    TemperatureOption,
    ToolOption,
    command_group,
    field_question,
    label_of,
    named,
    point_option,
    write_file,
)
from app.cli.simulate_campaign import simulate_campaign
from app.cli.simulate_thermal_drift import simulate_thermal_drift
from app.cli.simulate_verification import simulate_verification
from app.cli.terminal import echo
from app.decimal_text import read_number
from app.errors import counted, list_names
from app.geometry.body_diagonal import DIAGONALS
from thermap.answers import SimulatedStepDiagonal

_DECIMALS = 6
"""Of readings in µm: far below what any laser resolves."""

simulate = command_group()


def _two_angles(written: str) -> list[float] | None:
    angles = [read_number(part, decimal_comma=False) for part in written.split(",")]
    return [a for a in angles if a is not None] if len(angles) == 2 and None not in angles else None


simulate.command("verification")(simulate_verification)
simulate.command("campaign")(simulate_campaign)
simulate.command("thermal-drift")(simulate_thermal_drift)


@simulate.command("step-diagonal")
@asks
def simulate_step_diagonal(
    thermap: ThermapClient,
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
    tool: ToolOption = NO_OFFSET,
    steps: Annotated[int, typer.Option(min=1, help="Steps of each axis.")] = 10,
    origin: Annotated[
        Numbers | None,
        point_option(
            "Lowest corner of the volume in mm; that of the axes' travel if not stated.",
            such_as="0,0,0",
        ),
    ] = None,
    step: Annotated[
        Numbers | None,
        point_option("Length of each axis' step in mm; over the whole travel if not stated."),
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
    target: Annotated[
        Literal["point", "flat-mirror"], typer.Option(help="What reflects.")
    ] = "point",
    mirror_tilt: Annotated[
        Named | None,
        typer.Option(
            envvar="THERMAP_MIRROR_TILTS",
            metavar="DIAGONAL=A,B",
            parser=named("DIAGONAL=A,B with two angles in µrad such as ppp=100,0", _two_angles),
            help="Two tilts of a diagonal's mirror in µrad, about the horizontal and the other "
            "direction beside the diagonal, such as ppp=100,0.",
        ),
    ] = None,
    label: LabelOption = None,
    missing_as_zero: MissingOption = False,
) -> None:
    """Write what a laser would read on the four step diagonals of a stored machine.

    At these temperatures, or at the latest reading. `thermap import --method
    step-diagonal FILE --evaluate-only` shows what comes out of it.

    Example: `thermap simulate step-diagonal mcfv5050 --noise 0.2 -o laser.csv`
    """
    _expect_what_can_be(output, mirror_tilt or ())
    named = label_of(output, label)
    plan: dict[str, Any] = field_question(temperature, tool, missing_as_zero) | {
        "steps": steps,
        "noise_um": noise,
        "resolution_um": resolution,
        "seed": seed,
        "target": target,
        "mirror_tilts_urad": mirror_tilt or {},
    }
    plan |= {} if origin is None else {"origin_mm": origin}
    plan |= {} if step is None else {"step_mm": step}
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


def _expect_what_can_be(output: Path, tilted: Iterable[str]) -> None:
    if output.suffix.lower() == ".json":
        raise typer.BadParameter(f"expected a CSV file, got {str(output)!r}", param_hint="--output")
    if unknown := [diagonal for diagonal in tilted if diagonal not in DIAGONALS]:
        raise typer.BadParameter(
            f"expected one of {list_names(DIAGONALS)}, got {list_names(unknown)}",
            param_hint="--mirror-tilt",
        )
