"""What is written to the terminal, and nothing else: names and texts are anybody's.

Whatever a service, a file or an agent says comes through here, or through `console`, and can
neither move the cursor nor hide or colour anything.
"""

from __future__ import annotations

import sys

import typer

from app.foreign_text import printable


def echo(text: str, *, err: bool = False) -> None:
    """Write lines of text; in them what a terminal would obey is escaped."""
    typer.echo(printable_lines(text), err=err)


def write_document(text: str) -> None:
    """Write JSON or a file's text as it is; to a terminal, as `echo` does."""
    sys.stdout.write(printable_lines(text) if sys.stdout.isatty() else text)


def write_json(content: bytes) -> None:
    """Write an answer's JSON in a line of its own."""
    write_document(content.decode() + "\n")


def complain(sentence: str) -> None:
    """Write why a command failed."""
    typer.secho("thermap: ", err=True, fg="red", nl=False)
    echo(sentence, err=True)


def printable_lines(text: str) -> str:
    r"""Escape what a terminal obeys, but for the ends of lines.

    >>> printable_lines("one\ntwo\x1b[2J")
    'one\ntwo\\x1b[2J'
    """
    return "\n".join(map(printable, text.split("\n")))
