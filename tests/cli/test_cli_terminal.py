"""What anybody named or wrote is shown letter by letter: no markup, no commands to the terminal."""

import ast
import io
import re
from datetime import timedelta
from pathlib import Path

import pytest
from rich.table import Table
from rich.text import Text

import app.cli
from app.cli.answers import facts, listing
from app.cli.console import console
from app.cli.terminal import printable_lines
from tests.service_examples import MACHINE, START, error_map, iso, reading

HOSTILE = {
    "closing markup": "[/foo]",
    "markup": "[red]red",
    "a link": "[link=http://x]y[/link]",
    "an emoji": ":warning:",
    "an escape": "a\x1b[31m",
    "a title": "a\x1b]0;x\x07",
    "C1": "a\x9b2J",
    "from right to left": "a\u202eb",
    "a mark of direction": "a\u200fb",
    "a line separator": "a\u2028b",
}
ALLOWED = re.compile(r"[^\x00-\x09\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2066-\u2069]*")

CLI = Path(app.cli.__file__).parent


def printed(view):
    written = io.StringIO()
    terminal = console()
    terminal.file = written
    terminal.print(view)
    return written.getvalue()


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_view_shows_every_letter(kind):
    text = HOSTILE[kind]
    table = listing(text, "b")
    table.add_row("1", text)
    outer = Table(title=text)
    outer.add_row(table)
    for view in (text, table, facts((text, text)), outer):
        shown = printed(view)
        assert ALLOWED.fullmatch(shown)
        assert printable_lines(text) in shown
    assert ALLOWED.fullmatch(printed(Text(text)))


def test_only_one_file_writes_to_the_terminal():
    """A call that is not here cannot forget to escape."""
    wrong = []
    for path in CLI.glob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if not isinstance(node, ast.Call):
                continue
            called = ast.unparse(node.func)
            if called in ("print", "Console") or (
                called in ("typer.echo", "typer.secho", "sys.stdout.write", "sys.stderr.write")
                and path.name != "terminal.py"
            ):
                wrong.append(f"{path.name}, line {node.lineno}: {called}")
            if called == "TextColumn" and not any(k.arg == "markup" for k in node.keywords):
                wrong += [
                    f"{path.name}, line {node.lineno}: a text with markup"
                    for argument in node.args
                    if "{" in ast.unparse(argument)
                ]
    assert wrong == []


LISTINGS = [
    ("machines", "list"), ("machines", "show", "mill"), ("machines", "needs", "mill"),
    ("maps", "list"), ("maps", "show", "1"), ("models", "list"), ("models", "show"),
    ("sensors", "show"), ("readings", "list"), ("verifications", "list"), ("events",),
    ("analyses", "list"), ("status",), ("status", "mill"), ("compensate", "mill"),
    ("verifications", "residuals", "1"), ("connections",), ("picture", "mill"),
]  # fmt: skip
"""With --machine where they take one."""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["[/foo]", "[red]", "a\u202eb", "a\u200f[/]"])
def test_listings_show_any_name(thermap, client, name):
    client.create_machine(MACHINE | {"id": "mill", "name": name})
    for i, temperature in enumerate((20.0, 28.0)):
        client.store_error_map("mill", error_map(f"{name} {i}", temperature))
    client.store_readings(
        "mill",
        [reading(START + timedelta(minutes=i), 24.0) | {"state": {name: 1.0}} for i in range(6)],
    )
    client.store_verification(
        "mill",
        {
            "label": name,
            "datum": "absolute",
            "observations": [
                {
                    "time": iso(START + timedelta(minutes=i)),
                    "component": "EXX",
                    "position_mm": 250,
                    "measured_um": 10.5,
                    "setup": name,
                    "state": {name: 1.0},
                }
                for i in range(5)
            ],
        },
    )
    shown = ""
    for words in LISTINGS:
        for more in ((), ("--machine", "mill")):
            found = thermap(*words, *more, columns=300)
            assert found.exception is None or isinstance(found.exception, SystemExit), words
            assert ALLOWED.fullmatch(found.output), words
            shown += found.output
    assert shown.count(printable_lines(name)) >= 5
