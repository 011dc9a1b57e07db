"""Options that several commands share, and how their values are read."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, NamedTuple, TypeAlias

import typer

from app.cli.terminal import printable_lines
from app.decimal_text import read_number
from app.errors import ThermapError, list_names
from app.units import read_time as read_iso_time
from thermap import DEFAULT_URL, URL_VARIABLE

if TYPE_CHECKING:
    from thermap import ThermapClient


if TYPE_CHECKING:
    Named: TypeAlias = Mapping[str, Any]
    """Values of an option that is stated as `NAME=VALUE`, once for each."""
    Numbers: TypeAlias = Sequence[float]
    """Numbers of an option that is stated with commas between them."""
else:
    Named, Numbers = list[Any], Any


class _Pair(NamedTuple):
    name: str
    value: Any


def named(
    expected: str, read: Callable[[str], Any] = str, *, first: bool = False
) -> Callable[[str], _Pair]:
    """Make what reads one `NAME=VALUE`.

    Parameters
    ----------
    expected
        The form and what the value is, for the message.
    read
        Reads the value; None of what is none.
    first
        Whether the value follows the first `=`; else the last.
    """

    def read_pair(text: str) -> _Pair:
        split = text.partition("=") if first else text.rpartition("=")
        name, equals, written = (part.strip() for part in split)
        value = read(written) if written else None
        if not name or not equals or value is None:
            raise typer.BadParameter(f"expected {expected}, got {text!r}")
        return _Pair(name, value)

    return read_pair


def named_option(what: str, help: str, *names: str, **more: Any) -> Any:
    """Make an option that takes `NAME=NUMBER`, and says `what` the number is."""
    parser = named(f"NAME=NUMBER with {what}", read_number)
    return typer.Option(*names, parser=parser, help=help, **more)


def by_name(stated: Mapping[str, Any]) -> dict[str, Any]:
    """Index the pairs of each option by their names.

    Raises
    ------
    typer.BadParameter
        If one name is stated twice.
    """
    together = dict(stated)
    for option, pairs in stated.items():
        if isinstance(pairs, list) and all(isinstance(pair, _Pair) for pair in pairs):
            names = Counter(pair.name for pair in pairs)
            if twice := [name for name, n in names.items() if n > 1]:
                raise typer.BadParameter(
                    f"{list_names(twice)} is stated twice", param_hint=f"--{option}"
                )
            together[option] = dict(pairs)
    return together


def point_option(help: str, *names: str, such_as: str = "50,50,40") -> Any:
    """Make an option that takes a point in mm."""
    parser = numbers(f"X,Y,Z in mm, such as {such_as}", 3)
    return typer.Option(*names, metavar="X,Y,Z", parser=parser, help=help)


def numbers(expected: str, count: int | None = None) -> Callable[[str], list[float]]:
    """Make what reads so many numbers, or any, with commas between them.

    >>> numbers("X,Y,Z in mm, such as 0,0,160", 3)("0,0,-12.5")
    [0.0, 0.0, -12.5]
    """

    def read_numbers(text: str) -> list[float]:
        read = [read_number(part, decimal_comma=False) for part in text.split(",")]
        finite = [number for number in read if number is not None]
        if len(finite) != (count or len(read)) or len(read) != len(finite):
            raise typer.BadParameter(f"expected {expected}, got {text!r}")
        return finite

    return read_numbers


def page_option(help: str) -> Any:
    """Make an option that takes a page's file; one that could not be written is refused."""
    return typer.Option("--output", "-o", metavar="FILE.html", parser=_page, help=help)


def _page(text: str) -> Path:
    output = Path(text)
    if output.suffix.lower() != ".html":
        raise typer.BadParameter(f"expected a file that ends in .html, got {text!r}")
    if not output.absolute().parent.is_dir():
        raise typer.BadParameter(f"cannot write {output}: there is no such folder")
    return output


def _own_database() -> str:
    from app.settings import sqlite_url

    return sqlite_url("thermap.db")


DatabaseOption = Annotated[
    str,
    typer.Option(
        metavar="URL",
        default_factory=_own_database,
        show_default="thermap.db in your folder for data",
        help="sqlite:///FILE or postgresql://HOST/NAME.",
    ),
]
MachineArgument = Annotated[
    str, typer.Argument(metavar="MACHINE", envvar="THERMAP_MACHINE", help="The machine's id.")
]
VerificationsOption = Annotated[
    list[int] | None,
    typer.Option(
        "--verification",
        "-v",
        envvar="THERMAP_VERIFICATIONS",
        metavar="NUMBER",
        help="A verification's number, once for each; all that are stored without it.",
    ),
]

MachineOption = Annotated[
    str | None,
    typer.Option(
        "--machine",
        "-m",
        metavar="MACHINE",
        help="The machine's id; not needed where one machine is stored.",
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="The service's JSON, unchanged.")]
YesOption = Annotated[bool, typer.Option("--yes", "-y", help="Do it without asking.")]
UrlOption = Annotated[
    str, typer.Option("--url", envvar=URL_VARIABLE, metavar="URL", help="Where the service is.")
]
TemperatureOption = Annotated[
    Named | None,
    named_option(
        "a temperature in °C",
        "Temperature of one sensor in °C, such as x-middle=24.1; once for each sensor.",
        "--temperature",
        "-t",
        metavar="SENSOR=°C",
        envvar="THERMAP_TEMPERATURES",
    ),
]
ReportOption = Annotated[
    Path | None, page_option("Write the report, a page that needs no internet.")
]
VisitsOption = Annotated[
    Path | None,
    typer.Option(
        "--visits",
        metavar="FOLDER",
        help="Write the visits to make next, a file each, for measuring and for --plan.",
    ),
]
SeedOption = Annotated[
    int,
    typer.Option(min=0, help=("Seed of the noise: the same seed gives the same noise.")),
]
LabelOption = Annotated[
    str | None,
    typer.Option(help="The label in the file; without it, what the file is called."),
]


class NotConfirmed(ThermapError):
    """The user did not agree to what destroys."""


def command_group() -> typer.Typer:
    """Make a group of commands, such as `thermap machines`."""
    return typer.Typer(no_args_is_help=True, add_completion=False, rich_markup_mode="markdown")


def refuse_if(is_wrong: object, words: str, option: str) -> None:
    """Refuse options that do not go together as wrong usage."""
    if is_wrong:
        raise typer.BadParameter(words, param_hint=option)


def is_typed(ctx: typer.Context, option: str) -> bool:
    """Say whether an option was typed, and does not come from the environment."""
    return getattr(ctx.get_parameter_source(option), "name", "") == "COMMANDLINE"


def connect(url: str = DEFAULT_URL) -> ThermapClient:
    """Make a client; a URL that is none is wrong usage."""
    from thermap import ThermapClient

    try:
        return ThermapClient(url)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--url") from None


def chosen_machine(thermap: ThermapClient, named: str | None) -> str:
    """Give the machine that is meant: the one that is stated, or the only one that is stored.

    Raises
    ------
    typer.BadParameter
        If none is stated and several are stored, which are listed, or none is.
    """
    if named:
        return named
    stored = [machine.id for machine in thermap.machines()]
    if len(stored) == 1:
        return stored[0]
    several = f"several machines are stored: expected one of {list_names(stored)}, got none"
    none = "no machine is stored yet; `thermap import machine.json` stores one"
    raise typer.BadParameter(several if stored else none, param_hint="--machine")


def chosen_verifications(
    thermap: ThermapClient, machine: str, numbers: Sequence[int] | None
) -> list[int]:
    """Give the verifications that are meant: those stated, or all.

    Raises
    ------
    typer.BadParameter
        If none is stored.
    """
    chosen = list(numbers or ()) or [
        verification.id for verification in thermap.verifications(machine)
    ]
    if not chosen:
        raise typer.BadParameter(
            f"machine {machine!r} has no verification yet; `thermap verifications store FILE "
            f"--machine {machine}` stores one"
        )
    return chosen


def confirm(what: str, question: str, *, yes: bool) -> None:
    """Ask before something is destroyed.

    Parameters
    ----------
    what
        What would be done, for a refusal: `machine 'vmc' was not deleted`.

    Raises
    ------
    NotConfirmed
        If the user does not agree, or there is no terminal to ask on.
    """
    if yes:
        return
    if not sys.stdin.isatty():
        raise NotConfirmed(f"{what}: there is no terminal to ask on; --yes does it without asking")
    if not typer.confirm(printable_lines(question), err=True):
        raise NotConfirmed(what)


def label_of(output: Path, named: str | None) -> str:
    """Give the label that a simulated file states: its own name, unless another is stated.

    A label names one map or verification of a machine, so two files must not carry the same.

    Raises
    ------
    typer.BadParameter
        If a comment line of the file cannot hold it.

    >>> label_of(Path("monday/night-shift.csv"), None)
    'night-shift'
    """
    label = output.stem if named is None else named
    if not label.isprintable() or not label or label != label.strip(' ;,"'):
        raise typer.BadParameter(
            "expected a name in one line that begins and ends with neither a blank nor "
            f'one of ; , ", got {label!r}',
            param_hint="--label",
        )
    return label


def write_file(output: Path, text: str) -> None:
    """Write a file; one that cannot be written is wrong usage."""
    try:
        output.write_text(text, encoding="utf-8")
    except OSError as error:
        raise typer.BadParameter(
            f"cannot write {output}: {error.strerror}", param_hint="--output"
        ) from None


def expect_finite(options: Mapping[str, Any]) -> None:
    """Refuse numbers of options that are infinite or none at all.

    Parameters
    ----------
    options
        As `typer.Context.params` has them: names with underscores to values.

    Raises
    ------
    typer.BadParameter
        If one is not finite.
    """
    for name, value in options.items():
        if any(isinstance(v, float) and not isfinite(v) for v in _each(value)):
            raise typer.BadParameter(
                f"expected a finite number, got {value}", param_hint=f"--{name.replace('_', '-')}"
            )


def _each(value: object) -> Iterable[object]:
    return value if isinstance(value, list) else [value]


def time_option(name: str, help: str, **more: Any) -> Any:
    """Make an option that takes a time."""
    return typer.Option(name, metavar="TIME", parser=read_time, help=help, **more)


def read_time(text: str) -> datetime:
    """Read a time with its zone, as UTC.

    Raises
    ------
    typer.BadParameter
        If it is none, or has no zone.

    >>> read_time("2026-03-01T07:00:00+01:00")
    datetime.datetime(2026, 3, 1, 6, 0, tzinfo=datetime.timezone.utc)
    """
    try:
        return read_iso_time(text).astimezone(UTC)
    except ValueError:
        raise typer.BadParameter(
            f"expected a time with its zone such as 2026-03-01T06:00:00Z, got {text!r}"
        ) from None


_OPTIONS: Final = {
    "temperatures_c": "--temperature",
    "tool_offset_mm": "--tool",
    "missing_components": "--missing-as-zero",
    "exaggeration": "--exaggeration",
    "state": "--state",
}
"""Fields of a question, and the options that state them."""


class RefusedQuestion(ThermapError):
    """The service refused what options stated, told in their words."""


@contextmanager
def in_options() -> Iterator[None]:
    """Tell what the service refuses of a question by the options that state it."""
    from thermap.errors import InvalidContentError

    try:
        yield
    except InvalidContentError as error:
        refusal = error.sentence.replace("state 'zero'", "state --missing-as-zero")
        for field_error in error.errors:
            field, _, rest = field_error.field.partition(".")
            if field in _OPTIONS:
                refusal = refusal.replace(field_error.field, f"{_OPTIONS[field]} {rest}".strip())
        raise RefusedQuestion(refusal.removeprefix("--missing-as-zero: ")) from error


ToolOption = Annotated[
    Numbers,
    point_option("Tool offset in mm, such as 0,0,160.", "--tool", such_as="0,0,160"),
]
NO_OFFSET: Any = "0,0,0"
MissingOption = Annotated[
    bool,
    typer.Option(
        "--missing-as-zero", help="Let error components that no two maps have count as zero."
    ),
]


def field_question(
    temperature: Named | None, tool: Numbers, missing_as_zero: bool
) -> dict[str, Any]:
    """Write what questions about the machine in three dimensions share.

    Parameters
    ----------
    temperature, tool, missing_as_zero
        Values of the options; without a temperature the latest reading is meant.
    """
    question: dict[str, Any] = {
        "tool_offset_mm": tool,
        "missing_components": "zero" if missing_as_zero else "refuse",
    }
    return question | ({"temperatures_c": temperature} if temperature else {})
