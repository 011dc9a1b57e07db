"""thermap export and thermap compare: a controller's files, and what it holds of them."""

from __future__ import annotations

import json as json_text
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Protocol

import typer
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from app.cli.answers import listing
from app.cli.console import console
from app.cli.options import (
    JsonOption,
    MachineArgument,
    TemperatureOption,
    ToolOption,
    UrlOption,
    connect,
    in_options,
    read_named_numbers,
    read_point,
)
from app.cli.terminal import write_document
from app.decimal_text import read_number
from app.errors import ThermapError, list_names
from app.pages.report_parts.words import sentence
from thermap import DEFAULT_URL, calls
from thermap.answers import CheckAnswer, CompareAnswer, ExportAnswer, NotHeldAnswer

LARGEST_FILE = 4_000_000
"""Bytes of a file that is compared: no controller's table is larger."""

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
    list[str] | None,
    typer.Option(
        "--option",
        "-o",
        metavar="NAME=VALUE",
        help="Option of the format, such as sign=error, components=EXX,EYY or "
        '\'axes={"x": "AX1"}\'; once for each.',
    ),
]


class NamedText(Protocol):
    """A file as it is to be written."""

    @property
    def name(self) -> str:
        """Its name, inside the folder."""

    @property
    def content(self) -> str:
        """What it holds."""


class NotWritten(ThermapError):
    """Files could not be written, and none of them was."""


def controllers(json: JsonOption = False, url: UrlOption = DEFAULT_URL) -> None:
    """List the controllers' file formats and their options.

    With each its sign, its limits, and how surely all this is known.

    Example: `thermap controllers`
    """
    with connect(url) as thermap:
        if json:
            write_document(thermap.content(calls.controllers()).decode() + "\n")
            return
        formats = thermap.controllers().controllers
    terminal = console()
    for controller in formats:
        sign = (
            f"the {controller.sign}"
            if controller.sign
            else "to be stated (sign=error or sign=compensation)"
        )
        terminal.print(
            Text(controller.name, style="bold"), Text(f"{controller.title} · {controller.status}")
        )
        terminal.print(
            Text(f"  values: {sign}, {controller.units}; positions: {controller.spacing}")
        )
        terminal.print(Text(f"  limits: {controller.limits}"))
        for option in controller.options:
            default = "needed" if option.required else f"default {json_text.dumps(option.default)}"
            terminal.print(Text(f"  {option.name} ({default}): {option.description}", style="dim"))


def export(
    machine: MachineArgument,
    controller: ControllerOption,
    output: Annotated[
        Path | None,
        typer.Option("--output", metavar="FOLDER", help="Folder into which the files are written."),
    ] = None,
    temperature: TemperatureOption = None,
    option: FormatOption = None,
    begin: Annotated[
        list[str] | None,
        typer.Option("--from", metavar="SENSOR=°C", help="Where a range of temperatures begins."),
    ] = None,
    end: Annotated[
        list[str] | None,
        typer.Option("--to", metavar="SENSOR=°C", help="Where it ends; once for each sensor."),
    ] = None,
    step: Annotated[
        float | None,
        typer.Option(
            "--step", metavar="µM", help="Change from one table of the range to the next, in µm."
        ),
    ] = None,
    tool: ToolOption = "0,0,0",
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace files that are there already.")
    ] = False,
    json: JsonOption = False,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """Write the compensation as a controller's files: at these temperatures, or as it is now.

    Shows what the controller cannot hold, what spacing and rounding add, and which moves show
    whether the sign is right. All files are written, or none.

    Example: `thermap export mcfv5050 -c siemens-cec -o sign=error --output cec`
    """
    question = _question(temperature, option, tool) | _bands(begin, end, step)
    with connect(url) as thermap, in_options():
        call = calls.export_compensation(machine, controller, question)
        content = thermap.content(call)
        answer = ExportAnswer.model_validate_json(content, extra="ignore")
    if output is not None:
        write_files(output, answer.files, overwrite=overwrite)
    if json:
        write_document(content.decode() + "\n")
        return
    terminal = console()
    terminal.print(export_view(answer))
    where = f"written to {output}" if output else "written nowhere: state --output FOLDER"
    terminal.print(Text(f"{list_names(file.name for file in answer.files)}: {where}"))


def compare(
    machine: MachineArgument,
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE…", help="All files that the controller holds.")
    ],
    controller: ControllerOption,
    temperature: TemperatureOption = None,
    option: FormatOption = None,
    json: JsonOption = False,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """Compare what a controller holds with what it should hold: stale, forgotten, foreign.

    Example: `thermap compare mcfv5050 x.comp y.comp thermap.ini -c linuxcnc`
    """
    question = _question(temperature, option, "0,0,0")
    question["files"] = [{"name": path.name, "content": _text_of(path)} for path in files]
    with connect(url) as thermap, in_options():
        content = thermap.content(calls.compare_compensation(machine, controller, question))
    if json:
        write_document(content.decode() + "\n")
        return
    answer = CompareAnswer.model_validate_json(content, extra="ignore")
    console().print(compare_view(answer))


def _question(temperature: Iterable[str] | None, option: Iterable[str] | None, tool: str) -> Any:
    temperatures_c = read_named_numbers(temperature, "--temperature", "a temperature in °C")
    question: dict[str, Any] = {"options": read_options(option)}
    question["tool_offset_mm"] = read_point(tool, "--tool", "0,0,160")
    return question | ({"temperatures_c": temperatures_c} if temperatures_c else {})


def _bands(
    begin: Iterable[str] | None, end: Iterable[str] | None, step: float | None
) -> dict[str, Any]:
    if not begin and not end and step is None:
        return {}
    if not begin or not end or step is None:
        raise typer.BadParameter(
            "expected all of --from, --to and --step, got some of them", param_hint="--step"
        )
    return {
        "bands": {
            "from_c": read_named_numbers(begin, "--from", "a temperature in °C"),
            "to_c": read_named_numbers(end, "--to", "a temperature in °C"),
            "largest_step_um": step,
        }
    }


def read_options(texts: Iterable[str] | None) -> dict[str, Any]:
    """Read `NAME=VALUE` as often as it is stated: a number, JSON, or text as it is.

    Raises
    ------
    typer.BadParameter
        If a value is not of this form, or a name is stated twice.

    Examples
    --------
    >>> read_options(["sign=error", "spacing_mm=50", 'axes={"x": "AX1"}'])
    {'sign': 'error', 'spacing_mm': 50, 'axes': {'x': 'AX1'}}
    """
    options: dict[str, Any] = {}
    for text in texts or ():
        name, equals, written = text.partition("=")
        if not name.strip() or not equals or name.strip() in options:
            raise typer.BadParameter(
                f"expected NAME=VALUE, each name once, got {text!r}", param_hint="--option"
            )
        options[name.strip()] = _value_of(written.strip())
    return options


def _value_of(written: str) -> Any:
    if read_number(written, decimal_comma=False) is None and written[:1] not in '{["tfn':
        return written
    try:
        return json_text.loads(written)
    except ValueError:
        return written


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


def write_files(folder: Path, files: Iterable[NamedText], *, overwrite: bool = False) -> None:
    """Write all files into a folder, or none of them.

    Each is written beside its place first, and moved there when all of them are written.

    Raises
    ------
    NotWritten
        If one is there already and is not to be replaced, or cannot be written.
    """
    files = list(files)
    outside = [f.name for f in files if Path(f.name).is_absolute() or ".." in Path(f.name).parts]
    if outside:
        raise NotWritten(f"expected names inside {folder}, got {list_names(outside)}")
    there = [file.name for file in files if (folder / file.name).exists()]
    folders = [file.name for file in files if (folder / file.name).is_dir()]
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
            for file in files:
                place = Path(beside, file.name)
                place.parent.mkdir(parents=True, exist_ok=True)
                # As it came: controllers are particular about the ends of lines.
                place.write_bytes(file.content.encode())
            for file in files:
                (folder / file.name).parent.mkdir(parents=True, exist_ok=True)
                Path(beside, file.name).replace(folder / file.name)
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
