"""plotly's JavaScript, in a page or beside it."""

from __future__ import annotations

import re
from typing import Final

from markupsafe import Markup

from app.errors import InvalidContent

INLINE: Final = "inline"

_ADDRESS: Final = re.compile(r"https?://[^/\s]\S*|(\.{0,2}/(?!/)|[\w-])[^\s:]*", re.ASCII)
"""Of a file over HTTP, or beside the page; no other scheme, and no other host by `//`."""


def plotly_script(plotly_js: str) -> Markup:
    """Bring plotly's JavaScript into a page.

    Parameters
    ----------
    plotly_js
        `inline`, or the address from which the page is to load it.

    Raises
    ------
    InvalidContent
        If the address is none of a file over HTTP.
    """
    if plotly_js == INLINE:
        from plotly.offline import get_plotlyjs  # type: ignore[import-untyped]

        return Markup(f"<script>{get_plotlyjs()}</script>")
    if not _ADDRESS.fullmatch(plotly_js):
        raise InvalidContent.of_field(
            "plotly_js", f"expected `{INLINE}` or the address of plotly.min.js, got {plotly_js!r}"
        )
    return Markup('<script src="{}" charset="utf-8"></script>').format(plotly_js)
