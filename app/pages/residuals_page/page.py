"""Residuals as one page that needs nothing else."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

from app.errors import list_names
from app.identification.analysis.residual_curves import ComponentCurves
from app.identification.analysis.residual_report import ResidualFigures, Size
from app.pages.environment import render
from app.pages.plotly_script import INLINE
from app.pages.report_parts.component_names import component_name
from app.pages.report_parts.drawing import largest
from app.pages.report_parts.words import decimals_for
from app.pages.residuals_page.component_blocks import component_blocks
from app.pages.residuals_page.head import ResidualsHead, head_facts, size_sentence
from app.units import Unit


def residuals_page(
    head: ResidualsHead,
    figures: ResidualFigures,
    curves: Sequence[ComponentCurves],
    *,
    plotly_js: str = INLINE,
    back: str = "",
) -> str:
    """Write the page of residuals.

    Parameters
    ----------
    back
        Where it was opened; empty where that is nowhere.
    """
    blocks = component_blocks(figures, curves)
    drawn = {block.size.component for block in blocks}
    few = [c.component for c in figures.components if c.component not in drawn]
    return render(
        "residuals.html",
        plotly_js=plotly_js,
        head=head,
        back=back,
        figures=figures,
        head_facts=head_facts(head, figures),
        size_sentence=size_sentence(figures),
        by_unit=list(_by_unit(figures.components)),
        places={block.size.component: block.place for block in blocks},
        blocks=blocks,
        not_drawn=list_names(map(component_name, few)) if few else "",
        drawings=[drawing for block in blocks for drawing in block.drawings],
    )


def _by_unit(sizes: Sequence[Size]) -> Iterator[tuple[str, list[Size], int, float]]:
    """Put components of one unit together, the largest first, with decimals and reach."""
    order = [unit.symbol for unit in Unit]
    ordered = sorted(sizes, key=lambda size: (order.index(size.unit), -size.ratio))
    for unit, together in groupby(ordered, lambda size: size.unit):
        own = list(together)
        # A component that was measured once has no repeatability of its own.
        decimals = max(decimals_for(size.repeatability) for size in own)
        reach = largest((size.rms, size.by_noise or 0.0) for size in own)
        yield unit, own, decimals, 1.05 * reach or 1.0
