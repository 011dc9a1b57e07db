"""What a measurement yields, for a terminal: components, figures, notes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

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
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="bold")
    for heading in ("component", ""):
        table.add_column(heading, no_wrap=True)
    for heading in ("lowest", "highest", "std. error ≤"):
        table.add_column(heading, justify="right")
    for heading in ("unit", "positions"):
        table.add_column(heading, no_wrap=True)
    for entry in components:
        for row in _rows(entry):
            table.add_row(*row)
    return table


def _rows(entry: ComponentAnswer) -> Iterator[Sequence[str]]:
    """Write a component's rows: one, or one for each direction of approach."""
    component = COMPONENTS[entry.component]
    words = (entry.chapter or "", component.unit.symbol)
    for way, sign in (("", "+"), ("backward_", "-")):
        values = getattr(entry, way + component.input_field, None)
        if values is None:
            continue
        uncertainty = _largest(getattr(entry, way + component.standard_error_field, None))
        if not component.is_table:
            yield entry.component, words[0], signed(values), "", uncertainty, words[1], ""
            continue
        is_twofold = getattr(entry, f"backward_{component.input_field}", None) is not None
        name = f"{entry.component} {sign}" if is_twofold else entry.component
        over = _range_of(component.axis, entry.positions_mm or [])
        yield name, words[0], signed(min(values)), signed(max(values)), uncertainty, words[1], over


def _largest(standard_errors: Sequence[float] | float | None) -> str:
    if standard_errors is None:
        return "–"
    errors = standard_errors if isinstance(standard_errors, Sequence) else [standard_errors]
    return f"{max(errors):.2f}"


def _range_of(axis: str | None, positions_mm: Sequence[float]) -> str:
    if len(positions_mm) == 1:
        return f"{axis} {positions_mm[0]:g} mm"
    return f"{len(positions_mm)}: {axis} {positions_mm[0]:g} to {positions_mm[-1]:g} mm"


def _figures(figures: Mapping[str, float]) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0), pad_edge=False, header_style="bold")
    table.add_column("figure", no_wrap=True)
    table.add_column("", justify="right", no_wrap=True)
    table.add_column("", no_wrap=True)
    for name, value in figures.items():
        table.add_row(name, figure_text(value), unit_of_field(name) or "")
    return table
