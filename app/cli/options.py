"""Options that several commands share, and how their values are read."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Annotated, Any, Final

import typer

from app.client import ThermapClient
from app.client.connection import DEFAULT_URL, URL_VARIABLE
from app.settings import Settings

DEFAULT_HOST: Final[str] = Settings.model_fields["host"].default
DEFAULT_PORT: Final[int] = Settings.model_fields["port"].default

MachineArgument = Annotated[
    str, typer.Argument(metavar="MACHINE", envvar="THERMAP_MACHINE", help="The machine's id.")
]
UrlOption = Annotated[
    str, typer.Option("--url", envvar=URL_VARIABLE, metavar="URL", help="Where the service is.")
]
HostOption = Annotated[
    str, typer.Option("--host", envvar="THERMAP_HOST", metavar="HOST", help="Address to listen on.")
]
PortOption = Annotated[
    int,
    typer.Option(
        "--port",
        envvar="THERMAP_PORT",
        metavar="PORT",
        min=0,
        max=65535,
        help="Port; 0 takes any free one.",
    ),
]
TemperatureOption = Annotated[
    list[str] | None,
    typer.Option(
        "--temperature",
        "-t",
        envvar="THERMAP_TEMPERATURES",
        metavar="SENSOR=°C",
        help="Temperature of one sensor in °C, such as x-middle=24.1; once for each sensor.",
    ),
]

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def connect(url: str = DEFAULT_URL) -> ThermapClient:
    """Make a client; a URL that is none is wrong usage."""
    try:
        return ThermapClient(url)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--url") from None


def read_number(text: str, *, decimal_comma: bool = True) -> float | None:
    """Read a finite decimal number as people write it, or None where it is something else.

    >>> read_number(" 24,1 "), read_number("−3.5"), read_number("nan"), read_number("1_0")
    (24.1, -3.5, None, None)
    """
    written = text.strip().replace("\N{MINUS SIGN}", "-")
    if decimal_comma and "." not in written:
        written = written.replace(",", ".")
    return float(written) if _NUMBER.fullmatch(written) else None


def read_named_numbers(stated: Iterable[str] | None, option: str, what: str) -> dict[str, float]:
    """Read `NAME=NUMBER` as often as it is stated.

    Parameters
    ----------
    stated
        Values of the option.
    option
        Name of the option, for the message.
    what
        What the number is, for the message: `a temperature in °C`.

    Raises
    ------
    typer.BadParameter
        If a value is not of this form, or a name is stated twice.
    """
    found: dict[str, float] = {}
    for text in stated or ():
        name, equals, written = (part.strip() for part in text.rpartition("="))
        number = read_number(written)
        if not name or not equals or number is None:
            raise typer.BadParameter(
                f"expected NAME=NUMBER with {what}, came {text!r}", param_hint=option
            )
        if name in found:
            raise typer.BadParameter(f"{name} is stated twice", param_hint=option)
        found[name] = number
    return found


def read_point(text: str, option: str, example: str) -> list[float]:
    """Read `X,Y,Z` in mm.

    Raises
    ------
    typer.BadParameter
        If it is something else.

    >>> read_point("0,0,-12.5", "--tool", "0,0,160")
    [0.0, 0.0, -12.5]
    """
    numbers = [read_number(part, decimal_comma=False) for part in text.split(",")]
    found = [number for number in numbers if number is not None]
    if len(numbers) != 3 or len(found) != 3:
        raise typer.BadParameter(
            f"expected X,Y,Z in mm, such as {example}, came {text!r}", param_hint=option
        )
    return found


ToolOption = Annotated[
    str,
    typer.Option(
        "--tool",
        envvar="THERMAP_TOOL",
        metavar="X,Y,Z",
        help="Tool offset in mm, such as 0,0,160.",
    ),
]
MissingOption = Annotated[
    bool,
    typer.Option(
        "--missing-as-zero",
        envvar="THERMAP_MISSING_AS_ZERO",
        help="Let error components that no two maps have count as zero.",
    ),
]


def field_question(
    temperature: Iterable[str] | None, tool: str, missing_as_zero: bool
) -> dict[str, Any]:
    """Write what questions about the machine in three dimensions share.

    Parameters
    ----------
    temperature, tool, missing_as_zero
        Values of the options; without a temperature the latest reading is meant.

    Raises
    ------
    typer.BadParameter
        If a value cannot be read.
    """
    question: dict[str, Any] = {
        "tool_offset_mm": read_point(tool, "--tool", "0,0,160"),
        "missing_components": "zero" if missing_as_zero else "refuse",
    }
    temperatures_c = read_named_numbers(temperature, "--temperature", "a temperature in °C")
    return question | ({"temperatures_c": temperatures_c} if temperatures_c else {})
