"""A picture as JSON, for programs."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from plotly.graph_objects import Figure  # type: ignore[import-untyped]


def figure_json(figure: Figure) -> str:
    """Write a picture as plotly's JSON.

    Returns
    -------
    str
        Strict JSON with `data` and `layout`, which every plotly library reads.
    """
    written: str = figure.to_json()
    return written
