"""The picture of the work volume as a page."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final

from app.pages.environment import render
from app.pages.plotly_script import INLINE
from app.pages.report_parts.drawing import AXIS as DRAWN_AXIS
from app.pages.report_parts.drawing import FAINT as DRAWN_FAINT
from app.pages.report_parts.drawing import INK as DRAWN_INK
from app.pages.report_parts.drawing import PAPER, Drawing
from app.pictures.colours import FAINT, INK, LABEL, LENGTH_SCALE, QUIET
from app.pictures.figure_json import figure_json

if TYPE_CHECKING:
    from plotly.graph_objects import Figure  # type: ignore[import-untyped]

FIGURE_ID: Final = "work-volume"

CONFIG: Final = {
    "displaylogo": False,
    "responsive": True,
    "toImageButtonOptions": {"format": "png", "scale": 2, "filename": FIGURE_ID},
}

ON_PAGE: Final = {
    **{
        INK: DRAWN_INK,
        QUIET: DRAWN_AXIS,
        FAINT: DRAWN_FAINT,
        "white": PAPER,
        LABEL: "var(--label)",
    },
    **{colour: f"var(--length-{i})" for i, colour in enumerate(LENGTH_SCALE)},
}
"""Colours of a figure to those of a page, which may be dark: there the largest is the lightest."""


def picture_page(figure: Figure, *, plotly_js: str) -> str:
    """Write a complete page around a picture of the work volume.

    Raises
    ------
    InvalidContent
        If the address is none of a file over HTTP.

    Notes
    -----
    Title, subtitle, warnings and what is drawn stand outside the figure, where they wrap. They
    are shown letter by letter: no markup in them has an effect. Where plotly does not run, a
    sentence stands in the figure's place.
    """
    meta = figure.layout.meta or {}
    warnings = [] if meta.get("complete", True) else ["not complete"]
    return render(
        "picture.html",
        plotly_js=plotly_js,
        config=CONFIG,
        title=meta.get("title", ""),
        subtitle=meta.get("subtitle", ""),
        warnings=[*warnings, *meta.get("warnings", ())],
        address="" if plotly_js == INLINE else plotly_js,
        drawings=[_drawing(figure, meta.get("drawn", ""))],
    )


def _drawing(figure: Figure, alt_text: str) -> Drawing:
    """The figure without the texts that the page has around it."""
    drawn = _in_page_colours(json.loads(figure_json(figure)))
    layout = drawn["layout"]
    layout |= {"title": {}, "annotations": [], "meta": {"narrow": layout["meta"]["narrow"]}}
    layout["margin"] = {**layout.get("margin", {}), "t": 30, "b": 40}
    return Drawing(FIGURE_ID, "", alt_text, drawn["data"], layout)


def _in_page_colours(part: Any) -> Any:
    if isinstance(part, dict):
        return {name: _in_page_colours(value) for name, value in part.items()}
    if isinstance(part, list):
        return [_in_page_colours(value) for value in part]
    return ON_PAGE.get(part, part) if isinstance(part, str) else part
