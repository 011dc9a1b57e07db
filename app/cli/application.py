"""The commands together, and what a failure looks like: a sentence, never a traceback."""

from __future__ import annotations

import io
import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

import app as package
from app.cli.accuracy import accuracy
from app.cli.analyse import analyse
from app.cli.compensate import compensate
from app.cli.demo import demo
from app.cli.import_files import import_files
from app.cli.picture import picture
from app.cli.replay import replay
from app.cli.serve import serve
from app.cli.simulate import simulate
from app.client import NotListeningError, ThermapClientError
from app.errors import ThermapError


class ExplainingCommands(TyperGroup):
    """Commands whose failures are told on stderr, with exit code 1."""

    def invoke(self, ctx: Any) -> Any:
        """Run a command; wrong usage has exit code 2 and is told by typer itself."""
        try:
            return super().invoke(ctx)
        except NotListeningError as error:
            _fail(f"{error.detail}: start one with `thermap serve`")
        except ThermapClientError as error:
            _fail(error.sentence)
        except ThermapError as error:
            _fail(error.detail)


application = typer.Typer(
    name="thermap",
    cls=ExplainingCommands,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)
application.command("serve")(serve)
application.command("demo")(demo)
application.command("import")(import_files)
application.command("compensate")(compensate)
application.command("analyse")(analyse)
application.command("accuracy")(accuracy)
application.command("picture")(picture)
application.command("replay")(replay)
application.add_typer(simulate, name="simulate")


def _show_version(asked: bool) -> None:
    if asked:
        typer.echo(f"thermap {package.__version__}")
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


def _fail(sentence: str) -> None:
    typer.secho("thermap: ", err=True, fg="red", nl=False)
    typer.echo(sentence, err=True)
    raise typer.Exit(1)
