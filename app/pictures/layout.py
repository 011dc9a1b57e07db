"""All around what is drawn: texts, scales, the legend, and what the mouse does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.errors import counted
from app.geometry.components import LINEAR_LETTERS
from app.pictures.colours import FONT, INK, LABEL, QUIET, WARNING, length_axis
from app.pictures.distorted_volume import DistortedVolume
from app.pictures.scene import NARROW_PX, Json, narrow_scene, scene
from app.pictures.traces import Rounding, Trace
from app.pictures.words import largest_words, wrapped

TITLE_LETTERS: Final = 80
SUBTITLE_LETTERS: Final = 130
"""In a line: plotly does not wrap."""

MOST_WARNING_LINES: Final = 6
"""Above the drawing: further ones would leave no room for it. `meta` and a page have all."""

LEGEND: Final = {
    "orientation": "h",
    "x": 0,
    "y": 0,
    "yanchor": "top",
    "itemsizing": "constant",
}
HOVER_LABEL: Final = {
    "bgcolor": "white",
    "bordercolor": QUIET,
    "align": "left",
    "font": {"size": 13, "color": INK},
}


@dataclass(frozen=True, slots=True)
class Remarks:
    """What is to be said against the errors that are drawn.

    Parameters
    ----------
    complete
        Whether nothing is missing in them, or rests on what is old or out of range.
    counted_as_zero
        Components that are not known and count as zero.
    """

    complete: bool = True
    warnings: Sequence[str] = ()
    counted_as_zero: Sequence[str] = ()


@dataclass(frozen=True, slots=True)
class Texts:
    """What stands around a picture, as plain text."""

    title: str
    subtitle: str
    drawn: str
    remarks: Remarks


def layout(
    distorted: DistortedVolume, traces: Sequence[Trace], texts: Texts, rounding: Rounding
) -> Json:
    """Lay out a picture."""
    title = wrapped(texts.title, TITLE_LETTERS)
    subtitle = [*wrapped(texts.subtitle, SUBTITLE_LETTERS), *_warnings(texts.remarks)]
    box = scene(distorted.volume, _all_points(traces))
    return {
        # An empty template: plotly's own one would depend on a setting of the process.
        "template": {},
        "meta": {
            "title": texts.title,
            "subtitle": texts.subtitle,
            "drawn": texts.drawn,
            "exaggeration": distorted.exaggeration,
            "complete": texts.remarks.complete,
            "warnings": list(texts.remarks.warnings),
            "counted_as_zero": list(texts.remarks.counted_as_zero),
            "narrow": {"below_px": NARROW_PX, "changes": narrow_scene(distorted.volume, box)},
        },
        "title": _title(title, subtitle),
        "font": {"family": FONT, "size": 13, "color": INK},
        "paper_bgcolor": "white",
        "margin": {"l": 24, "r": 10, "t": 50 + 26 * len(title) + 18 * len(subtitle), "b": 100},
        "scene": {**box, "annotations": _labels(distorted, rounding)},
        "coloraxis": length_axis(distorted.largest_um, with_scale=distorted.has_errors),
        "legend": LEGEND,
        "hoverlabel": HOVER_LABEL,
        "annotations": [_below(texts.drawn)],
        # Among its default buttons one sends the whole figure to plotly's cloud.
        "modebar": {"remove": ["sendChartToCloud"]},
        # A new reading's picture keeps the view to which a person turned the last one.
        "uirevision": "work volume",
    }


def _title(title: list[str], subtitle: list[str]) -> Json:
    return {
        "text": "<br>".join(title),
        "font": {"size": 20},
        "subtitle": {"text": "<br>".join(subtitle), "font": {"size": 13, "color": QUIET}},
        **{"x": 0, "xanchor": "left", "xref": "paper"},
        **{"y": 1, "yanchor": "top", "yref": "container", "pad": {"t": 16}},
    }


def _warnings(remarks: Remarks) -> list[str]:
    """Break the warnings into lines that stand out, at most `MOST_WARNING_LINES`."""
    warnings = ([] if remarks.complete else ["not complete"]) + list(remarks.warnings)
    lines = [line for text in warnings for line in wrapped(f"! {text}", SUBTITLE_LETTERS)]
    if len(lines) > MOST_WARNING_LINES:
        lines = [*lines[: MOST_WARNING_LINES - 1], f"! … {counted(len(warnings), 'remark')} in all"]
    return [f'<span style="color:{WARNING}">{line}</span>' for line in lines]


def _below(text: str) -> Json:
    return {
        "text": "<br>".join(wrapped(text, SUBTITLE_LETTERS)),
        "showarrow": False,
        "align": "left",
        **{"xref": "paper", "x": 0, "xanchor": "left"},
        **{"yref": "paper", "y": 0, "yanchor": "top", "yshift": -40},
    }


def _labels(distorted: DistortedVolume, rounding: Rounding) -> list[Json]:
    """The largest error's length, above its ring: the axes' numbers stand below and left."""
    if not distorted.has_errors:
        return []
    x, y, z = distorted.worst.drawn_mm[0].tolist()
    label = {
        **{"x": x, "y": y, "z": z, "ax": 45, "ay": -40},
        "text": f"<b>{largest_words(distorted, rounding)}</b>",
        "font": {"size": 15, "color": INK},
        "bgcolor": LABEL,
        "arrowcolor": INK,
        "arrowwidth": 1.2,
        "arrowhead": 0,
        "standoff": 6,
    }
    return [label]


def _all_points(traces: Sequence[Trace]) -> FloatArray:
    """Every point that is drawn, gaps left out, shape (n, 3) [mm]."""
    columns = [[v for t in traces for v in t[a] if v is not None] for a in LINEAR_LETTERS]
    return np.array(columns).T
