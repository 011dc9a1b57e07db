"""Before and after by component: figures in a table, and a small picture in each row."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from statistics import median
from typing import Final

from app.identification.analysis import Analysis, ComponentFigures
from app.pages.report_parts.component_names import chapter_name, component_name
from app.pages.report_parts.drawing import largest
from app.pages.report_parts.size_picture import origins_text, size_picture
from app.pages.report_parts.tables import NUMBER, PICTURE, Column, body, row, table
from app.pages.report_parts.words import decimals_for, escaped, figure_text
from app.units import Unit

CHANGED: Final = 1e-9
"""Of the size before: less is rounding."""


def component_section(result: Analysis) -> str:
    """Write the table of all components, those of one unit together.

    Parameters
    ----------
    result
        The analysis' answer.

    Returns
    -------
    str
        HTML.
    """
    is_changed = bool(result.effects)
    title = "Before and after" if is_changed else "Residuals by component"
    order = [unit.symbol for unit in Unit]
    components = sorted(result.components, key=lambda c: order.index(c.unit))
    columns = _columns(is_changed)
    tables = "".join(
        table(columns, _rows(columns, list(own), is_changed), unit=f"[{escaped(unit)}]")
        for unit, own in groupby(components, lambda c: c.unit)
    )
    return f"""<section class="figures"><h2>{title}</h2>
<p class="quiet">{_how_to_read(components, is_changed)}</p>
{tables}
<p class="quiet">{origins_text(c.noise_origin for c in components)}</p></section>"""


def _how_to_read(components: Sequence[ComponentFigures], is_changed: bool) -> str:
    told = "Measured minus predicted, RMS on visits that took no part in what predicts them. "
    if not all(c.is_held_out for c in components):
        told += "† Nothing could be held out: all visits. "
    marks = "ring: before, filled: after" if is_changed else "ring: residual"
    return (
        f"{told}The floor is what repeatability and set-up scatter alone would leave. In the "
        f"pictures, which start at zero: {marks}, upright line: floor."
    )


def _columns(is_changed: bool) -> list[Column]:
    sizes = ["before", "after"] if is_changed else ["residual"]
    return [
        Column("component", width_percent=16),
        *(Column(name, NUMBER, 9) for name in (*sizes, "floor")),
        Column("scatter of one observation", NUMBER, 20),
        Column("95 % within, after" if is_changed else "95 % within", NUMBER, 9),
        Column("values", NUMBER, 9),
        Column("picture", PICTURE, 19 if is_changed else 28),
    ]


def _rows(
    columns: Sequence[Column], components: Sequence[ComponentFigures], is_changed: bool
) -> str:
    decimals = decimals_for(median(c.noise for c in components))
    sizes = [_sizes(c) for c in components]
    reach = 1.05 * largest(sizes) or 1.0
    rows = [
        row(columns, _cells(c, s, decimals, reach, is_changed), _style(s, is_changed))
        for c, s in zip(components, sizes, strict=True)
    ]
    return body(rows)


def _style(sizes: Sequence[float], is_changed: bool) -> str:
    before, after, _ = sizes
    return "strong" if is_changed and abs(after - before) > CHANGED * before else ""


def _cells(
    component: ComponentFigures,
    sizes: Sequence[float],
    decimals: int,
    reach: float,
    is_changed: bool,
) -> list[str]:
    name, code = component.component, escaped(component_name(component.component))
    mark = "" if component.is_held_out else "†"
    *shown, floor = (figure_text(size, decimals) for size in sizes)
    within = figure_text(component.after_p95 if is_changed else component.before_p95, decimals)
    scatter = f"{figure_text(component.noise, decimals)} ({component.noise_origin})"
    return [
        f'{code} <span class="quiet">{escaped(chapter_name(name))}</span>',
        *(f"{size}{mark}" for size in shown[: 1 + is_changed]),
        floor,
        escaped(scatter),
        f"±{within}",
        str(component.count),
        size_picture(sizes, reach, is_changed=is_changed) if component.count > 1 else "one value",
    ]


def _sizes(component: ComponentFigures) -> tuple[float, float, float]:
    """Give before, after, floor."""
    return *component.shown_rms, component.noise_floor
