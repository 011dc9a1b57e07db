"""The commands together, and what a failure looks like: a sentence, never a traceback.

A command is loaded when it is called: its name, its line of help and the version are told
without the service, the client or any numerics.
"""

from __future__ import annotations

import io
import sys
from importlib import import_module
from typing import Annotated, Any, Final

import typer
from typer.core import TyperCommand, TyperGroup

import app as package
from app.cli.terminal import complain, echo, printable_lines
from app.errors import ThermapError

COMMANDS: Final = {
    "serve": "Run the service until Ctrl-C or SIGTERM.",
    "worker": "Run the analyses that services are asked for, until Ctrl-C or SIGTERM.",
    "demo": "Run the service with a simulated machine that warms up and cools down.",
    "import": "Store machines, error maps and readings from files; no map before all are looked "
    "at.",
    "compensate": "Show the compensation table: for these temperatures, or at the latest reading.",
    "status": "Say whether machines can be trusted now, and why not.",
    "doctor": "Say whether all is well with a database and the service on it; exit code 1 where "
    "not.",
    "controllers": "List the controllers' file formats and their options.",
    "export": "Write the compensation as a controller's files: at these temperatures, or as it is "
    "now.",
    "compare": "Compare what a controller holds with what it should hold: stale, forgotten, "
    "foreign.",
    "program": "NC programs that move a machine through a measurement, and files for the readings.",
    "hal": "The live compensation in LinuxCNC: the motors follow the service's table.",
    "backup": "Write everything in the database to a file, while the service runs.",
    "restore": "Bring a backup into a database: whole, or not at all.",
    "keys": "Make, list and revoke the keys that a service asks for.",
    "events": "List what happened, the newest first: changes, alarms, sensors lost and back.",
    "connections": "Show how connections beside HTTP fare, or check their file.",
    "notify": "Show who is told of alarms and how that went, or send a test message.",
    "machines": "List, show, change and delete machines.",
    "maps": "List, show and delete error maps.",
    "models": "List, show, activate and compare model versions.",
    "sensors": "Show, assign and correlate the sensors that components follow.",
    "readings": "List and withdraw the temperatures that came.",
    "verifications": "Store, list and delete verifications; show what the model leaves of them.",
    "analyses": "List, show, cancel and delete analyses.",
    "analyse": "Find what the model lacks: compare it with measured data, and write a report.",
    "accuracy": "Show volumetric accuracy by every definition, and what controllers would leave of "
    "it.",
    "picture": "Draw the work volume with exaggerated errors: at these temperatures, or as it is "
    "now.",
    "replay": "Send recorded temperatures as readings, and show how the compensation table "
    "changes.",
    "simulate": "Simulated readings on a stored machine, or a whole machine with an undeclared "
    "effect.",
}
"""Command to the line that the list of commands has of it."""

_HOMES: Final = {
    "import": ("import_files", "import_files"),
    "export": ("controllers", "export"),
    "compare": ("controllers", "compare"),
    "restore": ("backup", "restore"),
}
"""Module below `app.cli` and name there of commands that are not in a module of their name."""


class Commands(TyperGroup):
    """Commands that are loaded when they are called; failures are told, with exit code 1."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        for name, summary in COMMANDS.items():
            self.commands[name] = TyperCommand(name, help=summary)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command that is meant, and load it."""
        name, _, rest = super().resolve_command(ctx, args)
        return name, None if name is None else load(name), rest

    def invoke(self, ctx: Any) -> Any:
        """Run a command; wrong usage has exit code 2 and is told by typer itself."""
        try:
            return super().invoke(ctx)
        except typer.BadParameter as wrong:
            _say_what_came(wrong)
            wrong.message = printable_lines(str(wrong.message))
            raise
        except ThermapError as error:
            _fail(error.detail)
        except Exception as error:
            _explain(error)
            raise


def load(name: str) -> Any:
    """Load a command, or a group of commands."""
    module, attribute = _HOMES.get(name, (name, name))
    command = getattr(import_module(f"app.cli.{module}"), attribute)
    if not isinstance(command, typer.Typer):
        alone = typer.Typer(
            add_completion=False, pretty_exceptions_enable=False, rich_markup_mode="markdown"
        )
        alone.command(name)(command)
        command = alone
    loaded = typer.main.get_command(command)
    loaded.help = loaded.help or COMMANDS[name]  # a group's, which says no more of itself
    _set_in_environment(loaded)
    return loaded


def _set_in_environment(command: Any) -> None:
    """Let each option be set in the environment: by its name, or by another that it states."""
    for option in command.params:
        if option.param_type_name == "option" and option.envvar is None and not option.is_eager:
            option.envvar = "THERMAP_" + option.opts[0].strip("-").replace("-", "_").upper()
    for below in getattr(command, "commands", {}).values():
        _set_in_environment(below)


application = typer.Typer(
    name="thermap",
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(requested: bool) -> None:
    if requested:
        echo(f"thermap {package.__version__}")
        raise typer.Exit


@application.callback()
def _describe(
    _version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    """Thermal error maps of machine tools, and the compensation table for live temperatures.

    Every option can also be set in the environment, as its help says.
    """


def main() -> None:
    """Run the command line."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # A console that knows no µ shows a question mark; it does not stop the command.
            stream.reconfigure(errors="replace")
    application(prog_name="thermap")


def _say_what_came(wrong: typer.BadParameter) -> None:
    """Tell of an option's value what was expected and what came, where typer has pydantic read it.

    Its own words leave out what came: of `nan` they say that it should be at least 0.
    """
    pydantic = sys.modules.get("pydantic")
    if pydantic is None or not isinstance(wrong.__cause__, pydantic.ValidationError):
        return
    from app.field_errors import field_error

    error = wrong.__cause__.errors()[0]
    # Of a word that is none of several typer says so itself, in a sentence of its own.
    _, is_choice, choices = error["msg"].partition(" is not one of ")
    if is_choice:
        wrong.message = f"expected one of {choices.rstrip('.')}, got {error['input']!r}"
        return
    wrong.message = field_error(error).message
    unit = _UNITS.get(str(wrong.param.metavar)) if wrong.param else None
    if unit:
        expected, got, came = wrong.message.partition(", got ")
        wrong.message = f"{expected}{' ' if expected[-1].isdigit() else ' in '}{unit}{got}{came}"


_UNITS: Final = {
    "DAYS": "days",
    "HOURS": "h",
    "MIN": "min",
    "SECONDS": "s",
    "S": "s",
    "MM": "mm",
    "UM": "µm",
    "µM": "µm",
    "µM/S": "µm/s",
    "MM/MIN": "mm/min",
}
"""What stands for an option's value in its help, to the unit in which it is."""


def _explain(error: Exception) -> None:
    """Tell what the client could not do; anything else is none of ours to tell."""
    client = sys.modules.get("thermap.errors")
    if client is None:  # then none of its errors can have come
        return
    if isinstance(error, client.ThermapClientError):
        _fail(error.sentence)


def _fail(sentence: str) -> None:
    complain(sentence)
    raise typer.Exit(1)
