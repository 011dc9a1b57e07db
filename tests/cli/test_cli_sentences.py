"""No sentence that the command line can show sends a person to HTTP."""

import ast
import re
from pathlib import Path

import app
from app.cli.application import COMMANDS, load

PACKAGE = Path(app.__file__).parent

OF_HTTP = re.compile(r"/v1\b|…/|\b(GET|POST|PUT|PATCH|DELETE)\b")
"""What only somebody who speaks HTTP understands."""

OF_SQL = re.compile(r"PRAGMA |DELETE FROM |WITH moved AS ")
"""What only a database is told begins so."""

DOCUMENTS = ("api/routes", "api/openapi.py")
"""What is written for those who do, and shown to nobody else."""


def sources():
    for path in sorted(PACKAGE.rglob("*.py")):
        if not path.relative_to(PACKAGE).as_posix().startswith(DOCUMENTS):
            yield path


def sentences_of(tree):
    """Every text of a module that is no docstring and none of a field's description."""
    silent = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            silent.add(id(node.value))
        if isinstance(node, ast.keyword) and node.arg == "description":
            silent |= {id(part) for part in ast.walk(node.value)}
    for node in ast.walk(tree):
        is_text = isinstance(node, ast.Constant) and isinstance(node.value, str)
        if is_text and id(node) not in silent:
            yield node


def test_no_message_names_a_route_or_a_method():
    found = [
        f"{path.relative_to(PACKAGE)}:{node.lineno}: {node.value!r}"
        for path in sources()
        for node in sentences_of(ast.parse(path.read_text(encoding="utf-8")))
        # A sentence has blanks; the name of a method or a path alone is none.
        if OF_HTTP.search(node.value) and " " in node.value.strip() and not OF_SQL.match(node.value)
    ]
    assert not found


def helps():
    """Every command's and option's help, as it is shown."""
    todo = [(name, load(name)) for name in COMMANDS]
    while todo:
        name, command = todo.pop()
        yield name, command.help or ""
        yield from (
            (f"{name} {one.name}", getattr(one, "help", "") or "") for one in command.params
        )
        todo += [(f"{name} {n}", c) for n, c in getattr(command, "commands", {}).items()]


def test_no_help_names_a_route_or_a_method():
    found = dict(helps())
    assert len(found) > 100
    assert not [name for name, text in found.items() if OF_HTTP.search(text)]
