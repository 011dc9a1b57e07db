"""Tables and other views in a terminal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn
from rich.segment import Segment
from rich.text import Text

from app.cli.terminal import printable_lines


class _Console(Console):
    """Takes no text for markup, and no letter for a command to the terminal."""

    def render_str(self, text: str, **how: Any) -> Text:
        """Make of a plain text what is measured and laid out."""
        return super().render_str(printable_lines(text), **how)

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        """Render a view; its styles are rich's own and are none of the text."""
        for segment in super().render(renderable, options):
            if segment.control or segment.text.isprintable():
                yield segment
            else:
                yield Segment(printable_lines(segment.text), segment.style)


def console(*, stderr: bool = False) -> Console:
    """Make what views are printed with, as wide as the terminal or the pipe is."""
    return _Console(stderr=stderr, markup=False, emoji=False, highlight=False)


def progress_bar(*columns: ProgressColumn) -> Progress:
    """Make a bar with what is being done before it: on a terminal, and nothing in a pipe."""
    terminal = console(stderr=True)
    words = TextColumn("{task.description}", markup=False)
    return Progress(
        words, BarColumn(), *columns, console=terminal, disable=not terminal.is_terminal
    )
