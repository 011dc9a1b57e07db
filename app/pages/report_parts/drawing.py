"""Figures of a report: plotly's data and layout, and the place in the page where each stands."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final, TypeAlias

from app.pages.report_parts.words import escaped
from app.pictures.colours import FONT

Json: TypeAlias = dict[str, Any]

PAPER: Final = "var(--paper)"
TIME: Final = "time"
TIMES: Final = (
    {"dtickrange": [None, 43_200_000], "value": "%H:%M<br>%-d %b"},
    {"dtickrange": [43_200_000, "M1"], "value": "%-d %b"},
    {"dtickrange": ["M1", None], "value": "%b %Y"},
)
"""How a time is written, by the time between two marks [ms]: plotly repeats the year."""

APPROACHES: Final = {1.0: "triangle-up", -1.0: "triangle-down"}
"""Marks by the direction of approach, where it decides."""

INK: Final = "var(--ink)"
AXIS: Final = "var(--axis)"
FAINT: Final = "var(--faint)"
BAND: Final = "var(--band)"
POINTS: Final = "var(--points)"
"""Colours are the style's, light or dark; the page's script looks them up."""

BEFORE: Final = "var(--before)"
"""Residuals without the effects: rings."""

AFTER: Final = "var(--after)"
"""Residuals with the effects: filled."""


@dataclass(frozen=True, slots=True)
class Drawing:
    """One figure of the page.

    Parameters
    ----------
    title, alt_text
        What stands above it, and what is read out where it cannot be seen; plain text.
    """

    id: str
    title: str
    alt_text: str
    data: Sequence[Json]
    layout: Json


def figures_json(drawings: Sequence[Drawing]) -> str:
    """Write all figures as the JSON that the page's script draws."""
    figures = {d.id: {"data": d.data, "layout": d.layout} for d in drawings}
    written = json.dumps(figures, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")
    return f'<script type="application/json" id="figures">{written}</script>'


def layout_of(x_title: str, y_title: str, extent: float, *, over_time: bool = False) -> Json:
    """Lay a figure out: axes with units, the same extent up and down, no template.

    Parameters
    ----------
    extent
        Largest size to be shown, in the unit of y.
    """
    axis = {
        "gridcolor": FAINT,
        "zeroline": False,
        "linecolor": AXIS,
        "ticks": "outside",
        "tickcolor": AXIS,
        "exponentformat": "none",
        "automargin": True,
    }
    reach = 1.08 * extent if extent > 0 else 1.0
    return {
        "template": {},
        "font": {"family": FONT, "size": 12, "color": INK},
        "paper_bgcolor": PAPER,
        "plot_bgcolor": PAPER,
        "margin": {"l": 46, "r": 8, "t": 8, "b": 40},
        "dragmode": False,
        "hovermode": "closest",
        "showlegend": False,
        "xaxis": {
            **axis,
            "title": {"text": escaped(x_title), "standoff": 6},
            "type": "date" if over_time else "linear",
            "nticks": 4,
            "tickangle": 0,
            **({"tickformatstops": TIMES} if over_time else {}),
        },
        "yaxis": {
            **axis,
            "title": {"text": escaped(y_title), "standoff": 4},
            "range": [-reach, reach],
            "zeroline": True,
            "zerolinecolor": AXIS,
            "nticks": 7,
        },
    }


def markers(x: Sequence[Any], y: Sequence[float], *, after: bool) -> Json:
    """Draw residuals: rings before, filled after; a filled one leaves its ring to be seen."""
    ring = {"color": BEFORE, "symbol": "circle-open", "size": 9, "line": {"width": 1.4}}
    filled = {"color": AFTER, "symbol": "circle", "size": 5}
    return {
        "type": "scatter",
        "mode": "markers",
        "x": list(x),
        "y": list(y),
        "marker": filled if after else ring,
        "name": "after" if after else "before",
    }


def pointing(trace: Json, directions: Sequence[float], *, after: bool) -> Json:
    """Let a trace's marks point the way of approach.

    Parameters
    ----------
    directions
        +1, −1 or 0 of each mark; where all are 0 the trace stays as it is.
    """
    if not any(directions):
        return trace
    ending = "" if after else "-open"
    symbols = [f"{APPROACHES.get(direction, 'circle')}{ending}" for direction in directions]
    return {**trace, "marker": {**trace["marker"], "symbol": symbols, "size": 6 if after else 10}}


def dates(times_s: Sequence[float]) -> list[str]:
    """Write times as plotly reads them.

    Parameters
    ----------
    times_s
        Seconds since 1970-01-01 UTC.

    Examples
    --------
    >>> dates([0.0])
    ['1970-01-01 00:00:00']
    """
    return [f"{datetime.fromtimestamp(t, UTC):%Y-%m-%d %H:%M:%S}" for t in times_s]


def largest(columns: Iterable[Sequence[float]]) -> float:
    """Give the largest size in some columns; 0 of none.

    Examples
    --------
    >>> largest([[1.0, -3.0], []]), largest([])
    (3.0, 0.0)
    """
    return max((abs(v) for column in columns for v in column), default=0.0)


def hover_texts(names: Sequence[str]) -> Mapping[str, Any]:
    """Say under the mouse what a mark belongs to."""
    return {
        "text": [escaped(name) for name in names],
        "hovertemplate": "%{text}<br>%{x}<br>%{y}<extra></extra>",
    }
