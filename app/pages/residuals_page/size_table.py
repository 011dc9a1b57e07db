"""The sizes by component: figures in a table, and a small picture in each row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby

from app.identification.residual_report import ResidualFigures, Size
from app.pages.report_parts.component_names import chapter_name, component_name
from app.pages.report_parts.drawing import largest
from app.pages.report_parts.size_picture import origins_text, size_picture
from app.pages.report_parts.tables import NUMBER, PICTURE, Column, body, row, table
from app.pages.report_parts.words import decimals_for, escaped, figure_text
from app.pages.residuals_page.head import percent_text
from app.units import Unit

COLUMNS = (
    Column("component", width_percent=16),
    Column("values", NUMBER, 8),
    *(Column(name, NUMBER, 8) for name in ("mean", "RMS")),
    Column("95 % within", NUMBER, 9),
    Column("repeatability", NUMBER, 17),
    Column("ratio", NUMBER, 7),
    Column("share above", NUMBER, 8),
    Column("picture", PICTURE, 19),
)


def over_noise(size: Size) -> float:
    """Give the RMS in repeatabilities; 0 where nothing is known of them.

    Parameters
    ----------
    size
        Of one component.

    Returns
    -------
    float

    Examples
    --------
    >>> of_rms_3 = ("EXX", "µm", 8, 0.0, 3.0, 6.0)
    >>> over_noise(Size(*of_rms_3, 1.5, "declared", 0.9))
    2.0
    >>> over_noise(Size(*of_rms_3, None, "residuals", None))
    0.0
    """
    noise = size.repeatability
    return size.rms / noise if noise else 0.0


def size_section(figures: ResidualFigures, places: Mapping[str, str]) -> str:
    """Write the table of all components, those of one unit together, the largest first.

    Parameters
    ----------
    figures
        The residuals.
    places
        Where in the page a component's plots are, of those that have some.

    Returns
    -------
    str
        HTML.
    """
    order = [unit.symbol for unit in Unit]
    sizes = sorted(figures.components, key=lambda c: (order.index(c.unit), -over_noise(c)))
    tables = "".join(
        table(COLUMNS, _rows(list(own), places), unit=f"[{escaped(unit)}]")
        for unit, own in groupby(sizes, lambda c: c.unit)
    )
    return f"""<section class="figures"><h2>By component</h2>
<p class="quiet">The largest for their repeatability first. In the pictures, which start at zero:
ring: RMS, upright line: repeatability; the ratio is of the two. Of noise alone 32 % would exceed
the repeatability. A component's name leads to its plots.</p>
{tables}
<p class="quiet">{origins_text(c.repeatability_origin for c in sizes)}</p></section>"""


def _rows(sizes: Sequence[Size], places: Mapping[str, str]) -> str:
    # A component that was measured once has no repeatability of its own.
    decimals = max(decimals_for(size.repeatability) for size in sizes)
    sizes_drawn = [(s.rms, s.rms, s.repeatability or 0.0) for s in sizes]
    reach = 1.05 * largest(sizes_drawn) or 1.0
    return body(
        row(COLUMNS, _cells(size, decimals, size_picture(own, reach, is_changed=False), places))
        for size, own in zip(sizes, sizes_drawn, strict=True)
    )


def _cells(size: Size, decimals: int, picture: str, places: Mapping[str, str]) -> list[str]:
    name = size.component
    code = escaped(component_name(name))
    if name in places:
        code = f'<a href="#{places[name]}">{code}</a>'
    share, ratio = size.share_above_repeatability, over_noise(size)
    noise = f"{figure_text(size.repeatability, decimals)} ({size.repeatability_origin})"
    is_one = size.count == 1
    return [
        f'{code} <span class="quiet">{escaped(chapter_name(name))}</span>',
        str(size.count),
        figure_text(size.mean, decimals),
        figure_text(size.rms, decimals),
        f"±{figure_text(size.p95, decimals)}",
        escaped(noise),
        f"{ratio:.1f}" if ratio else "–",
        "–" if share is None or is_one else percent_text(share),
        "one value" if is_one else picture,
    ]
