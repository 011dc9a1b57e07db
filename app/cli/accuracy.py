"""thermap accuracy: volumetric accuracy by every definition, and what controllers leave of it."""

from __future__ import annotations

from typing import Annotated

import orjson
import typer
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from app.cli.answers import listing, show_view
from app.cli.asking import ThermapClient, asks
from app.cli.options import (
    NO_OFFSET,
    MachineArgument,
    MissingOption,
    TemperatureOption,
    ToolOption,
    field_question,
)
from app.cli.terminal import write_json
from thermap.answers import AccuracyAnswer, LevelsAnswer

_LEVELS = {
    "nothing": "none",
    "displacement": "displacement tables",
    "straightness": "straightness and squareness too",
    "angular": "angular errors too",
    "nonrigid": "nonrigid slopes too",
}


@asks
def accuracy(
    thermap: ThermapClient,
    machine: MachineArgument,
    temperature: TemperatureOption = None,
    tool: ToolOption = NO_OFFSET,
    missing_as_zero: MissingOption = False,
    json: Annotated[
        bool,
        typer.Option("--json", help="The service's JSON, both answers."),
    ] = False,
) -> None:
    """Show volumetric accuracy by every definition, and what controllers would leave of it.

    At these temperatures, or at the latest reading; over the axes' travel.

    Example: `thermap accuracy mcfv5050 --tool 0,0,160 -t x-middle=24.1 -t z-column=27.3`
    """
    question = field_question(temperature, tool, missing_as_zero)
    answer = thermap.volumetric_accuracy(machine, question)
    levels = thermap.compensation_levels(machine, question)
    if json:
        both = {
            "accuracy": answer.model_dump(mode="json"),
            "levels": levels.model_dump(mode="json"),
        }
        write_json(orjson.dumps(both))
        return
    show_view(accuracy_view(answer, levels))


def accuracy_view(answer: AccuracyAnswer, levels: LevelsAnswer) -> RenderableType:
    """Lay out both answers for a terminal."""
    volume = " × ".join(f"{axis} {t.min_mm:g} to {t.max_mm:g}" for axis, t in answer.volume.items())
    head = Text(f"{answer.machine}, model version {answer.model_version}; {volume} mm")
    parts: list[RenderableType] = [head, _definitions(answer), _levels(levels)]
    if answer.counted_as_zero:
        parts.append(
            Text(f"! counted as zero: {', '.join(answer.counted_as_zero)}", style="yellow")
        )
    parts += [Text(f"! {warning}", style="yellow") for warning in answer.warnings]
    return Group(*parts)


def _definitions(answer: AccuracyAnswer) -> Table:
    table = listing("volumetric accuracy", "", "of", right="lrl")
    rows = [
        (
            "definition 1",
            answer.with_arms.definition_1_um,
            "µm",
            "error at the tool, longest vector",
        ),
        ("definition 2", answer.with_arms.definition_2_um, "µm", "error at the tool, ranges"),
        ("definition 1", answer.linear.definition_1_um, "µm", "translations alone (8.118)"),
        ("definition 2", answer.linear.definition_2_um, "µm", "translations alone (8.128)"),
        ("definition 1", answer.angular.definition_1_urad, "µrad", "rotations (8.119)"),
        ("definition 2", answer.angular.definition_2_urad, "µrad", "rotations (8.129)"),
        ("Ed", answer.Ed_um, "µm", "largest range on a body diagonal (ISO 230-6)"),
        ("ESd", answer.ESd_um, "µm", "range over all body diagonals"),
        ("ELv", answer.ELv_um, "µm", "displacement along the axes"),
        ("ELSv", answer.ELSv_um, "µm", "displacement, straightness, squareness"),
    ]
    for name, value, unit, of in rows:
        table.add_row(name, f"{value:.2f} {unit}", of)
    for name, ratio in answer.ratios.items():
        below = {"M1": "ELv", "M2": "Ed", "M3": "ESd"}[name]
        table.add_row(name, "–" if ratio is None else f"{ratio:.2f}", f"ELSv/{below}")
    return table


def _levels(levels: LevelsAnswer) -> Table:
    table = listing("the controller compensates", "mean", "RMS", "largest left [µm]", right="lrrr")
    for level in levels.levels:
        mean, rms, largest = (f"{um:.2f}" for um in (level.mean_um, level.rms_um, level.max_um))
        sampled = " (sampled)" if level.within_um is None else ""
        table.add_row(_LEVELS.get(level.level, level.level), mean, rms, largest + sampled)
    return table
