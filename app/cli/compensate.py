"""thermap compensate: the table for stated temperatures, or at the latest reading."""

from __future__ import annotations

import sys
from typing import Annotated, Any

import typer
from rich.console import Console

from app.cli.options import (
    MachineArgument,
    TemperatureOption,
    UrlOption,
    connect,
    in_options,
    read_named_numbers,
)
from app.cli.table_view import table_view
from thermap import DEFAULT_URL, ThermapClient, calls
from thermap.answers import CompensationAnswer
from thermap.call import Call


def compensate(
    machine: MachineArgument,
    temperature: TemperatureOption = None,
    state: Annotated[
        list[str] | None,
        typer.Option(
            envvar="THERMAP_STATE",
            metavar="NAME=NUMBER",
            help="A number of the machine's state, such as spindle_rpm=8000.",
        ),
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", envvar="THERMAP_JSON", help="The service's JSON, unchanged.")
    ] = False,
    url: UrlOption = DEFAULT_URL,
) -> None:
    """Show the compensation table: for these temperatures, or at the latest reading.

    Errors and compensation are in µm, µrad or µm/m as each row says; positions in mm.
    The compensation is minus the error: what is to be added to the command.

    Example: `thermap compensate mcfv5050 -t x-middle=24.1 -t z-column=27.3`
    """
    temperatures_c = read_named_numbers(temperature, "--temperature", "a temperature in °C")
    numbers = read_named_numbers(state, "--state", "a number of the machine's state")
    if numbers and not temperatures_c:
        raise typer.BadParameter(
            "goes with --temperature; the latest reading has its own state", param_hint="--state"
        )
    with connect(url) as thermap, in_options():
        if json:
            call: Call[Any] = calls.current_table(machine, etag=None)
            if temperatures_c:
                call = calls.compensation(machine, temperatures_c, numbers)
            sys.stdout.write(thermap.content(call).decode() + "\n")
            return
        console = Console(highlight=False)
        console.print(table_view(_table(thermap, machine, temperatures_c, numbers), console.width))


def _table(
    thermap: ThermapClient,
    machine: str,
    temperatures_c: dict[str, float],
    state: dict[str, float],
) -> CompensationAnswer:
    if temperatures_c:
        return thermap.compensation(machine, temperatures_c, state)
    tagged = thermap.current_table(machine)
    assert tagged is not None  # without an ETag there is always a table
    return tagged.table
