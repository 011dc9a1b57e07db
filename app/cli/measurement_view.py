"""What a measurement yields, for a terminal: components, figures, notes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import isnan
from typing import Final

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from app.cli.answers import listing
from app.cli.compensate import signed
from app.geometry.components import COMPONENTS
from app.pages.report_parts.words import sentence
from app.units import unit_of_field
from thermap.answers import ComponentAnswer, MeasurementAnswer

DECIMALS: Final = 4
"""Of figures: a tenth of a nanometre, a tenth of a micrometre where they are in mm."""


def figure_text(value: float) -> str:
    """Write a figure with as many decimals as say something.

    >>> figure_text(0.020412), figure_text(4.0), figure_text(-1e-12), figure_text(123456.789)
    ('0.0204', '4', '0', '123456.789')
    """
    rounded = round(value, DECIMALS) + 0.0  # which takes the sign from a negative zero
    return f"{rounded:.{DECIMALS}f}".rstrip("0").rstrip(".")


def measurement_view(answer: MeasurementAnswer) -> RenderableType:
    """Lay out components with their extremes, figures with their units, and notes."""
    parts: list[RenderableType] = []
    if answer.components:
        parts += [components_table(answer.components), Text()]
    if answer.figures:
        parts += [_figures(answer.figures), Text()]
    return Group(*parts, *(Text(f"note: {sentence(note)}") for note in answer.notes))


def components_table(components: Sequence[ComponentAnswer]) -> Table:
    """Lay out components with their extremes, largest standard error and positions."""
    table = listing(
        *("component", "", "lowest", "highest", "std. error ≤", "unit", "positions"),
        right="LLrrrLL",
    )
    for entry in components:
        for row in _rows(entry):
            table.add_row(*row)
    return table


def _rows(entry: ComponentAnswer) -> Iterator[Sequence[str]]:
    """Write a component's rows: one, or one for each direction of approach."""
    for direction in entry.directions:
        arrays = entry.to_numpy(direction)
        name = entry.component if direction == "both" else f"{entry.component} {direction}"
        least, most = signed(arrays.error.min()), signed(arrays.error.max())
        over = _range_of(COMPONENTS[entry.component].axis, entry.positions_mm or [])
        largest = arrays.standard_error.max()
        uncertainty = "–" if isnan(largest) else f"{largest:.2f}"
        highest = "" if arrays.positions_mm is None else most
        yield name, entry.chapter or "", least, highest, uncertainty, arrays.unit, over


def _range_of(axis: str | None, positions_mm: Sequence[float]) -> str:
    if not positions_mm:
        return ""
    if len(positions_mm) == 1:
        return f"{axis} {positions_mm[0]:g} mm"
    return f"{len(positions_mm)}: {axis} {positions_mm[0]:g} to {positions_mm[-1]:g} mm"


def _figures(figures: Mapping[str, float]) -> Table:
    table = listing("figure", "", "", right="LRL")
    for name, value in figures.items():
        table.add_row(name, figure_text(value), unit_of_field(name) or "")
    return table
