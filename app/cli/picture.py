"""thermap picture: the distorted work volume, written to a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import orjson
import typer
from rich.console import Group, RenderableType
from rich.text import Text

from app.cli.answers import show_view
from app.cli.asking import ThermapClient, asks
from app.cli.options import (
    NO_OFFSET,
    MachineArgument,
    MissingOption,
    TemperatureOption,
    ToolOption,
    field_question,
    write_file,
)
from app.pages.picture_page import picture_page
from app.pages.plotly_script import INLINE


@asks
def picture(
    thermap: ThermapClient,
    machine: MachineArgument,
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="A page (.html), which needs no internet, or a plotly figure (.json).",
        ),
    ],
    temperature: TemperatureOption = None,
    tool: ToolOption = NO_OFFSET,
    exaggeration: Annotated[
        float | None,
        typer.Option(
            help="How many times larger than they are errors are drawn; chosen if not stated."
        ),
    ] = None,
    missing_as_zero: MissingOption = False,
) -> None:
    """Draw the work volume with exaggerated errors: at these temperatures, or as it is now.

    Example: `thermap picture mcfv5050 --tool 0,0,160 -o mcfv5050.html`
    """
    if output.suffix.lower() not in (".html", ".json"):
        raise typer.BadParameter(
            f"expected a file that ends in .html or .json, got {str(output)!r}",
            param_hint="--output",
        )
    question = field_question(temperature, tool, missing_as_zero)
    if exaggeration is not None:
        question["exaggeration"] = exaggeration
    figure = thermap.picture(machine, question)
    write_file(output, _written(figure, output.suffix.lower()))
    show_view(_view(output, figure["layout"]["meta"]))


def _view(output: Path, meta: Mapping[str, Any]) -> RenderableType:
    """Say what was drawn, and what is to be said against it."""
    lines = list(meta["warnings"])
    if meta["counted_as_zero"]:
        lines.insert(0, f"counted as zero: {', '.join(meta['counted_as_zero'])}")
    if not meta["complete"]:
        lines.insert(0, "not complete")
    warnings = [Text(f"! {text}", style="yellow") for text in lines]
    return Group(Text(f"{output}: {meta['drawn']}"), *warnings)


def _written(figure: dict[str, object], suffix: str) -> str:
    """Write a figure as a page that needs nothing else, or as it is."""
    if suffix == ".json":
        return orjson.dumps(figure, option=orjson.OPT_INDENT_2).decode()
    # Importing plotly takes as long as all else that a command needs to start.
    from plotly.graph_objects import Figure  # type: ignore[import-untyped]

    return picture_page(Figure(figure), plotly_js=INLINE)
