"""What the demonstration shows: the chapter's argument, the table, and where it stands later."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from rich.console import Group, RenderableType
from rich.text import Text

from app.cli.answers import listing
from app.cli.compensate import signed, table_view
from app.simulation.example.remaining_error import RemainingError
from thermap.answers import CurrentCompensationAnswer


def argument_view(rows: Iterable[RemainingError]) -> RenderableType:
    """Show what remains uncompensated, with two maps, and with three."""
    sizes = [f"{size} {unit}" for unit in ("µm", "µm/m", "µrad") for size in ("RMS", "max")]
    table = listing("run", "error maps used", *sizes, right="llRRRRRR")
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


def current_view(table: CurrentCompensationAnswer, width: int) -> RenderableType:
    """Lay the table of a moment out."""
    return Group(
        Text.assemble(("SIMULATED ", "bold yellow"), "a reading every second; Ctrl-C ends it"),
        table_view(table, width, hint="/docs leads to all"),
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
