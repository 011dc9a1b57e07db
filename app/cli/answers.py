"""How a service's answer is shown: its JSON unchanged, or a view of it for a terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from datetime import datetime
from itertools import zip_longest
from typing import TYPE_CHECKING, TypeVar

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from app.cli.console import console
from app.cli.terminal import write_json
from app.errors import list_names

if TYPE_CHECKING:
    from thermap import ThermapClient
    from thermap.call import Call

Answer = TypeVar("Answer")


def show(
    thermap: ThermapClient,
    call: Call[Answer],
    view: Callable[[Answer], RenderableType],
    *,
    json: bool,
) -> None:
    """Send a call and show its answer.

    Parameters
    ----------
    json
        Write the service's JSON instead.
    """
    if json:
        write_json(thermap.content(call))
    else:
        show_view(view(thermap.send(call)))


def shell_words(words: Iterable[str]) -> str:
    """Write words as a shell takes them, in the quotes that every system's shell knows.

    >>> shell_words(["EXX=x-middle", "EZZ=T1 bed"])
    'EXX=x-middle "EZZ=T1 bed"'
    """
    return " ".join(f'"{word}"' if " " in word else word for word in words)


def show_view(view: RenderableType) -> None:
    """Write a view to the terminal, or into a pipe, as wide as that is."""
    console().print(view)


def listing(*headings: str, right: str = "") -> Table:
    """Make a table of some columns without lines.

    Parameters
    ----------
    right
        A letter for each column: r where it holds numbers, which stand right. A capital one is not
        wrapped.
    """
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="bold")
    for heading, letter in zip_longest(headings, right[: len(headings)], fillvalue="l"):
        is_right = letter in "rR"
        table.add_column(heading, justify="right" if is_right else "left", no_wrap=letter.isupper())
    return table


def or_nothing(table: Table, nothing: str) -> RenderableType:
    """Give a table, or a sentence where it has no rows."""
    return table if table.row_count else Text(nothing)


def followed_sensors(assignment: Mapping[str, str], **limited: int) -> Table:
    """Lay out which components follow which sensor; `limit` is that of `list_names`."""
    table = listing("sensor", "is followed by")
    for sensor in dict.fromkeys(assignment.values()):
        components = [code for code, name in assignment.items() if name == sensor]
        table.add_row(sensor, list_names(components, **limited))
    return table


def facts(*rows: tuple[str, str]) -> Table:
    """Lay out what is known of one thing: a name and what it says in each row."""
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, show_header=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column()
    for name, says in rows:
        table.add_row(name, says)
    return table


def when(time: datetime | None) -> str:
    """Write a time to the minute, in UTC as everything is.

    >>> from datetime import UTC
    >>> when(datetime(2026, 3, 1, 6, 0, 30, tzinfo=UTC)), when(None)
    ('2026-03-01 06:00', '')
    """
    return "" if time is None else f"{time:%Y-%m-%d %H:%M}"


def temperatures(temperatures_c: dict[str, float]) -> str:
    """Write temperatures in °C, the unit being said elsewhere.

    >>> temperatures({"x-middle": 20.125, "spindle": 24.0})
    'x-middle 20.12, spindle 24.00'
    """
    return ", ".join(f"{sensor} {value:.2f}" for sensor, value in temperatures_c.items())
