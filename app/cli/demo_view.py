"""What the demonstration shows: the chapter's argument, and the table that lives."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.table import Table
from rich.text import Text

from app.api.schemas.compensation import CurrentCompensationAnswer
from app.cli.table_view import signed, table_view
from app.demo.remaining_error import RemainingError

_TALL_ROWS, _AIRY_ROWS = 41, 29
"""Rows of a terminal in which errors fit above their compensation; in which blank lines do."""


def argument_view(rows: Iterable[RemainingError]) -> RenderableType:
    """Show what remains uncompensated, with two maps, and with three."""
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="dim")
    table.add_column("run")
    table.add_column("error maps used")
    for heading in ("RMS µm", "max µm", "RMS µm/m", "max µm/m"):
        table.add_column(heading, justify="right", no_wrap=True)
    for row in rows:
        numbers = (row.rms_um, row.max_um, row.rms_um_per_m, row.max_um_per_m)
        maps = ", ".join(label.removeprefix("Run ") for label in row.stored)
        table.add_row(
            "" if row.stored else row.run,
            maps or "none (uncompensated)",
            *(f"{number:.2f}" for number in numbers),
            style="bold" if len(row.stored) > 2 else "",
        )
    return Group(
        Text.assemble(
            ("SIMULATED ", "bold yellow"),
            ("error that remains on runs that no map was taken from", "bold"),
        ),
        table,
        Text(
            "µm: the nine linear components; µm/m: the three squareness errors. The machine is not "
            "linear, so three maps leave less than two (C. Wang, 8.2.9).",
            style="dim",
        ),
    )


def live_view(table: CurrentCompensationAnswer, console: Console) -> RenderableType:
    """Lay the live table out so that it fits the terminal."""
    return Group(
        Text.assemble(("SIMULATED ", "bold yellow"), "a reading every second; Ctrl-C ends it"),
        table_view(
            table,
            console.width,
            tight=console.is_terminal and console.height < _AIRY_ROWS,
            hint="/docs leads to all",
            compensation_only=console.is_terminal and console.height < _TALL_ROWS,
        ),
    )


def short_line(table: CurrentCompensationAnswer) -> str:
    """Say in a line where the table stands: temperatures, and each unit's greatest error."""
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
