"""Residuals over time: each visit's mean, before and after, beside what visits and maps scatter."""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, sqrt
from typing import Final

from app.identification.analysis.analysis import Analysis
from app.identification.analysis.figures import ComponentFigures
from app.identification.analysis.plots import VisitMeans
from app.pages.report_parts.component_names import component_name
from app.pages.report_parts.drawing import (
    BAND,
    Drawing,
    Json,
    dates,
    largest,
    layout_of,
    markers,
    pointing,
)

MOST_DRAWN: Final = 6
"""Components: more small figures are not read."""

FEWEST_VISITS: Final = 2
STANDARD_DEVIATIONS: Final = 2.0


def visit_drawings(result: Analysis) -> list[Drawing]:
    """Draw the means by visit of the components that have most to say.

    Returns
    -------
    list of Drawing
        At most six: components of effects first, then what is unexplained, then the largest
        means for their scatter.
    """
    figures = {c.component: c for c in result.components}
    curves = [
        c for c in result.plots.visits if c.component in figures and len(c.time_s) >= FEWEST_VISITS
    ]
    named = [name for e in result.effects for name in e.components]
    named += [part.component for part in result.unexplained]
    order = {name: i for i, name in reversed(list(enumerate(named)))}
    curves.sort(
        key=lambda c: (
            order.get(c.component, len(named)),
            -_largest_surprise(c, figures[c.component]),
        )
    )
    is_changed = bool(result.effects)
    return [
        _drawing(number, curve, figures[curve.component], is_changed)
        for number, curve in enumerate(curves[:MOST_DRAWN], start=1)
    ]


def _drawing(
    number: int, curve: VisitMeans, figures: ComponentFigures, is_changed: bool
) -> Drawing:
    x = dates(curve.time_s)
    expected = _expected(curve, figures)
    data: list[Json] = [
        _band(x, expected),
        pointing(markers(x, curve.before, after=False), curve.direction, after=False),
    ]
    if is_changed:
        data.append(pointing(markers(x, curve.after, after=True), curve.direction, after=True))
    unit, name = curve.unit, component_name(curve.component)
    extent = largest([curve.before, curve.after, [STANDARD_DEVIATIONS * max(expected)]])
    alt_text = (
        f"Means by visit of the residuals of {name} in {unit} over time, {len(x)} visits: within "
        f"±{largest([curve.before]):.3g} {unit} before"
        + (f", ±{largest([curve.after]):.3g} {unit} after" if is_changed else "")
    )
    layout = layout_of("", f"mean [{unit}]", extent, over_time=True)
    return Drawing(f"visits-{number}", name, alt_text, data, layout)


def _largest_surprise(curve: VisitMeans, figures: ComponentFigures) -> float:
    """Give the largest mean for what it is expected to scatter."""
    expected = _expected(curve, figures)
    means: Sequence[float] = curve.before
    return max(abs(mean) / max(e, 1e-12) for mean, e in zip(means, expected, strict=True))


def _expected(curve: VisitMeans, figures: ComponentFigures) -> Sequence[float]:
    """Standard deviation of each visit's mean; in older results without what the maps add."""
    if curve.expected:
        return curve.expected
    setup = figures.setup_scatter or 0.0
    return [hypot(figures.noise / sqrt(count), setup) for count in curve.count]


def _band(x: Sequence[str], expected: Sequence[float]) -> Json:
    """Two standard deviations to either side, as one grey shape."""
    upper = [round(STANDARD_DEVIATIONS * e, 6) for e in expected]
    return {
        "type": "scatter",
        "mode": "lines",
        "x": [*x, *reversed(x)],
        "y": [*upper, *(-u for u in reversed(upper))],
        "fill": "toself",
        "fillcolor": BAND,
        "line": {"width": 0},
        "hoverinfo": "skip",
        "name": "expected scatter of a visit's mean",
    }
