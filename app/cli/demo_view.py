"""What the demonstration shows: the chapter's argument, and the table that lives."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.segment import Segment, SegmentLines
from rich.table import Table
from rich.text import Text

from app.cli.compensate import Layout, signed, table_view
from app.simulation.example.remaining_error import RemainingError
from thermap.answers import CurrentCompensationAnswer

_LAYOUTS: Final = (
    (Layout.FULL, False),
    (Layout.COMPENSATION, False),
    (Layout.COMPENSATION, True),
    (Layout.PAIRED, True),
)
"""From the tallest to the lowest: what is shown, and whether blank lines are left out."""


def argument_view(rows: Iterable[RemainingError]) -> RenderableType:
    """Show what remains uncompensated, with two maps, and with three."""
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="dim")
    table.add_column("run")
    table.add_column("error maps used")
    for unit in ("µm", "µm/m", "µrad"):
        table.add_column(f"RMS {unit}", justify="right", no_wrap=True)
        table.add_column(f"max {unit}", justify="right", no_wrap=True)
    for row in rows:
        numbers = (row.rms_um, row.max_um, row.rms_um_per_m, row.max_um_per_m)
        angles = (row.rms_urad, row.max_urad)
        maps = ", ".join(label.removeprefix("Run ") for label in row.stored)
        table.add_row(
            "" if row.stored else row.run,
            maps or "none",
            *(f"{number:z.2f}" for number in (*numbers, *angles)),
            style="bold" if len(row.stored) > 2 else "",
        )
    return Group(
        Text.assemble(
            ("SIMULATED ", "bold yellow"),
            ("error that remains on runs that no map was taken from", "bold"),
        ),
        table,
        Text(
            "none: uncompensated. µm: the nine linear components; µm/m: the three squareness "
            "errors; µrad: the nine angular ones. The machine is not linear, so three maps leave "
            "less than two (C. Wang, 8.2.9).",
            style="dim",
        ),
    )


def live_view(table: CurrentCompensationAnswer, console: Console) -> RenderableType:
    """Lay the live table out so that it fits the terminal; in a pipe everything is shown."""
    if not console.is_terminal:
        return _laid_out(table, console.width, Layout.FULL, tight=False)
    # The last row stays free: the shell's prompt comes there without moving the view.
    rows = console.height - 1
    too_high = []
    for layout, tight in _LAYOUTS:
        view = _laid_out(table, console.width, layout, tight=tight)
        lines = console.render_lines(view, pad=False)
        if len(lines) <= rows:
            return SegmentLines(lines, new_lines=True)
        too_high.append(lines)
    return _cut(min(too_high, key=len), max(rows - 1, 0))


def _cut(lines: list[list[Segment]], rows: int) -> RenderableType:
    """Show as many lines as there is room for, and say how high the terminal should be."""
    return Group(
        SegmentLines(lines[:rows], new_lines=True),
        Text(f"and {len(lines) - rows} more lines in a terminal of {len(lines) + 1}", "yellow"),
    )


def _laid_out(
    table: CurrentCompensationAnswer, width: int, layout: Layout, *, tight: bool
) -> RenderableType:
    return Group(
        Text.assemble(("SIMULATED ", "bold yellow"), "a reading every second; Ctrl-C ends it"),
        table_view(table, width, layout=layout, tight=tight, hint="/docs leads to all"),
    )


def short_line(table: CurrentCompensationAnswer) -> str:
    """Say in a line where the table stands: temperatures, and the greatest linear error."""
    temperatures = ", ".join(
        f"{sensor.sensor} {sensor.temperature_c:.2f}"
        for sensor in table.sensors
        if sensor.temperature_c is not None
    )
    greatest = max(
        (entry for entry in table.components if entry.errors_um),
        key=lambda entry: float(np.abs(entry.errors_um or [0.0]).max()),
    )
    errors, positions = greatest.errors_um or [0.0], greatest.positions_mm or [0.0]
    most = int(np.abs(errors).argmax())
    return (
        f"{table.reading_time:%H:%M:%S} UTC  {temperatures} °C  greatest: {greatest.component} "
        f"at {positions[most]:g} mm, error {signed(errors[most])} µm"
    )
