"""A component's size beside its scatter: the small picture, and where the scatter comes from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from app.pages.report_parts.style import AFTER, BEFORE
from app.pages.report_parts.words import escaped
from app.pictures.colours import FAINT, INK

ORIGINS: Final = {
    "declared": "what the verifications state, adjusted where the residuals say otherwise",
    "replicates": "from what was read again at the same place in the same visit",
    "residuals": "from what is left within the visits",
}
"""Where the scatter of one observation comes from."""


def origins_text(found: Iterable[str]) -> str:
    """Explain where the scatter of one observation comes from, as far as it occurs.

    Parameters
    ----------
    found
        Origins that occur.

    Returns
    -------
    str
        HTML.
    """
    occurring = set(found)
    told = [f"{origin}: {words}" for origin, words in ORIGINS.items() if origin in occurring]
    return escaped(f"Scatter of one observation – {'; '.join(told)}.")


def size_picture(sizes: Sequence[float], reach: float, *, is_changed: bool) -> str:
    """Draw a row's figures on a line that starts at zero; the numbers stand beside it.

    Parameters
    ----------
    sizes
        Before, after, floor.
    reach
        What the line's end stands for.
    is_changed
        Whether after is drawn too.

    Returns
    -------
    str
        SVG.
    """
    before, after, floor = (f"{100.0 * size / reach:.2f}%" for size in sizes)
    line = '<line x1="{}" x2="{}" y1="{}" y2="{}" stroke="{}" stroke-width="{}"/>'
    parts: Iterable[str] = (
        line.format(0, "100%", 10, 10, FAINT, 1),
        line.format(after, before, 10, 10, BEFORE, 1.5) if is_changed else "",
        line.format(floor, floor, 3, 17, INK, 1.5),
        f'<circle cx="{before}" cy="10" r="4.5" fill="#fff" stroke="{BEFORE}" stroke-width="1.8"/>',
        f'<circle cx="{after}" cy="10" r="3" fill="{AFTER}"/>' if is_changed else "",
    )
    return f'<svg aria-hidden="true" focusable="false">{"".join(parts)}</svg>'
