"""thermap export and thermap compare: a controller's files, and what it holds of them."""

from __future__ import annotations

import json as json_text
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from app.cli.answers import listing
from app.cli.asking import Shown, ThermapClient, asks, calls
from app.cli.console import console
from app.cli.options import (
    NO_OFFSET,
    JsonOption,
    MachineArgument,
    Named,
    TemperatureOption,
    ToolOption,
    named,
    named_option,
)
from app.cli.terminal import write_json
from app.decimal_text import read_number
from app.errors import ThermapError, list_names
from app.pages.report_parts.words import sentence
from thermap.answers import (
    CheckAnswer,
    CompareAnswer,
    ControllersAnswer,
    ExportAnswer,
    NotHeldAnswer,
)

LARGEST_FILE = 4_000_000
"""Bytes of a file that is compared: no controller's table is larger."""


def _value_of(written: str) -> Any:
    """Read a number, JSON, or text as it is.

    >>> [_value_of(text) for text in ("error", "50", '{"x": "AX1"}')]
    ['error', 50, {'x': 'AX1'}]
    """
    if read_number(written, decimal_comma=False) is None and written[:1] not in '{["tfn':
        return written
    try:
        return json_text.loads(written)
    except ValueError:
        return written


ControllerOption = Annotated[
    str,
    typer.Option(
        "--controller",
        "-c",
        metavar="NAME",
        help="Format, such as linuxcnc; `thermap controllers` lists them.",
    ),
]
FormatOption = Annotated[
    Named | None,
    typer.Option(
        "--option",
        "-o",
        metavar="NAME=VALUE",
        parser=named("NAME=VALUE", _value_of, first=True),
        help="Option of the format, such as sign=error, components=EXX,EYY or "
        '\'axes={"x": "AX1"}\'; once for each.',
    ),
]


class NotWritten(ThermapError):
    """Files could not be written, and none of them was."""


@asks
def controllers() -> Shown:
    """List the controllers' file formats and their options.

    With each its sign, its limits, and how surely all this is known.

    Example: `thermap controllers`
    """
    return Shown(calls.controllers(), controllers_view)


def controllers_view(answer: ControllersAnswer) -> RenderableType:
    """Lay out all formats."""
    lines: list[Text] = []
    for controller in answer.controllers:
        sign = (
            f"the {controller.sign}"
            if controller.sign
            else "to be stated (sign=error or sign=compensation)"
        )
        title = f" {controller.title} · {controller.status}"
        lines += [
            Text.assemble((controller.name, "bold"), title),
            Text(f"  values: {sign}, {controller.units}; positions: {controller.spacing}"),
            Text(f"  limits: {controller.limits}"),
        ]
        for option in controller.options:
            default = "needed" if option.required else f"default {json_text.dumps(option.default)}"
            lines.append(Text(f"  {option.name} ({default}): {option.description}", style="dim"))
    return Group(*lines)


@asks
def export(
    thermap: ThermapClient,
    machine: MachineArgument,
    controller: ControllerOption,
    output: Annotated[
        Path | None,
        typer.Option("--output", metavar="FOLDER", help="Folder into which the files are written."),
    ] = None,
    temperature: TemperatureOption = None,
    option: FormatOption = None,
    begin: Annotated[
        Named | None,
        named_option(
            "a temperature in °C",
            "Where a range of temperatures begins.",
            "--from",
            metavar="SENSOR=°C",
        ),
    ] = None,
    end: Annotated[
        Named | None,
        named_option(
            "a temperature in °C",
            "Where it ends; once for each sensor.",
            "--to",
            metavar="SENSOR=°C",
        ),
    ] = None,
    step: Annotated[
        float | None,
        typer.Option(
            "--step", metavar="µM", help="Change from one table of the range to the next, in µm."
        ),
    ] = None,
    tool: ToolOption = NO_OFFSET,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace files that are there already.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Write the compensation as a controller's files: at these temperatures, or as it is now.

    Shows what the controller cannot hold, what spacing and rounding add, and which moves show
    whether the sign is right. All files are written, or none.

    Example: `thermap export mcfv5050 -c siemens-cec -o sign=error --output cec`
    """
    question = _question(temperature, option) | _bands(begin, end, step)
    question["tool_offset_mm"] = tool
    content = thermap.content(calls.export_compensation(machine, controller, question))
    answer = ExportAnswer.model_validate_json(content, extra="ignore")
    if output is not None:
        write_files(output, {f.name: f.content for f in answer.files}, overwrite=overwrite)
    if json:
        write_json(content)
        return
    terminal = console()
    terminal.print(export_view(answer))
    where = f"written to {output}" if output else "written nowhere: state --output FOLDER"
    terminal.print(Text(f"{list_names(file.name for file in answer.files)}: {where}"))


@asks
def compare(
    machine: MachineArgument,
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE…", help="All files that the controller holds.")
    ],
    controller: ControllerOption,
    temperature: TemperatureOption = None,
    option: FormatOption = None,
) -> Shown:
    """Compare what a controller holds with what it should hold: stale, forgotten, foreign.

    Example: `thermap compare mcfv5050 x.comp y.comp thermap.ini -c linuxcnc`
    """
    question = _question(temperature, option)
    question["files"] = [{"name": path.name, "content": _text_of(path)} for path in files]
    return Shown(calls.compare_compensation(machine, controller, question), compare_view)


def _question(temperature: Named | None, option: Named | None) -> dict[str, Any]:
    question: dict[str, Any] = {"options": option or {}}
    return question | ({"temperatures_c": temperature} if temperature else {})


def _bands(begin: Named | None, end: Named | None, step: float | None) -> dict[str, Any]:
    if not begin and not end and step is None:
        return {}
    if not begin or not end or step is None:
        raise typer.BadParameter(
            "expected all of --from, --to and --step, got some of them", param_hint="--step"
        )
    return {"bands": {"from_c": begin, "to_c": end, "largest_step_um": step}}


def _text_of(path: Path) -> str:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise typer.BadParameter(
            f"cannot read {path}: {error.strerror}", param_hint="FILE"
        ) from None
    if len(content) > LARGEST_FILE:
        raise typer.BadParameter(
            f"expected a file of at most {LARGEST_FILE} bytes, got {path} with {len(content)}",
            param_hint="FILE",
        )
    # Controllers write the encodings of their time; comments alone may lose a letter.
    return content.decode("utf-8", errors="replace")


def write_files(folder: Path, files: Mapping[str, str], *, overwrite: bool = False) -> None:
    """Write all files, content by name, into a folder, or none of them.

    Each is written beside its place first, and moved there when all of them are written.

    Raises
    ------
    NotWritten
        If one is there already and is not to be replaced, or cannot be written.
    """
    outside = [name for name in files if Path(name).is_absolute() or ".." in Path(name).parts]
    if outside:
        raise NotWritten(f"expected names inside {folder}, got {list_names(outside)}")
    there = [name for name in files if (folder / name).exists()]
    folders = [name for name in files if (folder / name).is_dir()]
    if folders:
        raise NotWritten(f"{list_names(folders)} in {folder} is a folder: nothing was written")
    if there and not overwrite:
        raise NotWritten(
            f"{list_names(there)} in {folder} would be replaced: nothing was written; "
            "--overwrite replaces them"
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder, prefix=".thermap-") as beside:
            for name, content in files.items():
                place = Path(beside, name)
                place.parent.mkdir(parents=True, exist_ok=True)
                # As it came: controllers are particular about the ends of lines.
                place.write_bytes(content.encode())
            for name in files:
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                Path(beside, name).replace(folder / name)
    except OSError as error:
        raise NotWritten(f"cannot write into {folder}: {error.strerror}") from None


def export_view(answer: ExportAnswer) -> RenderableType:
    """Lay out an export for a terminal."""
    temperatures = ", ".join(f"{s} {t:.2f} °C" for s, t in answer.temperatures_c.items())
    head = (
        f"{answer.machine}, model version {answer.model_version}, at {temperatures}; "
        f"{answer.controller}, values are the {answer.sign}"
    )
    parts: list[RenderableType] = [Text(head)]
    if answer.check:
        parts += [Text("\nCheck after loading: a move, and how much further than before it ends"),
                  _checks(answer.check), Text()]  # fmt: skip
    for band in answer.bands or []:
        ends = ", ".join(f"{s} {band.from_c[s]:.2f} to {t:.2f}" for s, t in band.to_c.items())
        parts += [Text(f"{band.folder}: {ends} °C"), _checks(band.check)]
    resampled = ", ".join(
        f"{row.component} {row.largest_deviation:.2f} {row.unit}" for row in answer.resampling
    )
    parts.append(Text(f"spacing and rounding add at most: {resampled}"))
    parts += _not_held("not held", answer.not_held)
    parts += [Text(f"! {sentence(warning)}", style="yellow") for warning in answer.warnings]
    return Group(*parts)


def _not_held(what: str, omissions: Iterable[NotHeldAnswer]) -> list[Text]:
    """Say once why components are not in the files, and how much each of them is at most."""
    alike: dict[str, list[str]] = {}
    for omission in omissions:
        alike.setdefault(omission.why, []).append(
            f"{omission.component} {omission.largest:.2f} {omission.unit}"
        )
    return [
        Text(f"! {what}: {', '.join(sizes)} at most; {why}", style="yellow")
        for why, sizes in alike.items()
    ]


def _checks(checks: Iterable[CheckAnswer]) -> Table:
    table = listing("axis", "to [mm]", "direction", "moves", "by [µm]", "shows", right="lrllrl")
    for check in checks:
        table.add_row(
            check.axis.upper(),
            f"{check.position_mm:g}",
            check.direction,
            check.moved_axis.upper(),
            f"{check.expected_movement_um:+.2f}",
            check.component,
        )
    return table


_STATES = {
    "both": "",
    "missing": "not in the files",
    "unknown": "in the files, not in the model",
}


def compare_view(answer: CompareAnswer) -> RenderableType:
    """Lay out a comparison for a terminal."""
    head = f"{answer.machine}, model version {answer.model_version}: held minus wanted"
    table = listing("component", "largest", "RMS", "at [mm]", "direction", "", right="lrrrll")
    for component in answer.components:
        table.add_row(
            component.component,
            f"{component.largest:+.2f} {component.unit}",
            f"{component.rms:.2f} {component.unit}",
            "" if component.position_mm is None else f"{component.position_mm:g}",
            component.direction,
            _STATES[component.state],
        )
    parts: list[RenderableType] = [Text(head), table]
    parts += _not_held("not compared", answer.not_held)
    parts += [Text(f"! {sentence(warning)}", style="yellow") for warning in answer.warnings]
    return Group(*parts)
