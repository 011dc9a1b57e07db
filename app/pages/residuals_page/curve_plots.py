"""A component's residuals over one quantity: mean and scatter, with single values behind."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import Any, Final

from app.identification.analysis.residual_curves import ResidualCurve
from app.identification.analysis.residual_report import Size
from app.identification.residuals.summary import Bin
from app.pages.report_parts.component_names import component_name
from app.pages.report_parts.drawing import (
    BAND,
    BEFORE,
    POINTS,
    Drawing,
    Json,
    dates,
    hover_texts,
    largest,
    layout_of,
)
from app.pages.report_parts.words import decimals_for, figure_text

TIME: Final = "time [s]"
DIRECTION: Final = "direction "
SIGNS: Final = {"−": -1.0, "not stated": 0.0, "+": 1.0}

STANDARD_DEVIATIONS: Final = 2.0
FAR_OUT: Final = 2.5
"""In 95th percentiles: what lies further would press all else flat."""

WIDE: Final = 0.5
GOLDEN: Final = 0.6180339887
"""Multiples of it fill a width evenly, however many they are."""

FEW: Final = 100
DIGITS: Final = 5


def movement(curve: ResidualCurve) -> float:
    """Say how far the means move along a quantity, without what single values' scatter moves them.

    Returns
    -------
    float
        Root mean square [the residuals' unit]; 0 where it is no more than chance.

    Examples
    --------
    >>> low, high = (Bin("", None, None, 50, mean, 1.0, 2.0, None) for mean in (-1.0, 1.0))
    >>> movement(ResidualCurve("", (low, high), (), ()))
    1.0
    """
    bins = curve.bins
    count = sum(b.count for b in bins)
    if count <= len(bins):
        return 0.0
    mean = sum(b.count * b.mean for b in bins) / count
    between = sum(b.count * (b.mean - mean) ** 2 for b in bins) / count
    within = sum(b.count * _spread(b) ** 2 for b in bins) / (count - len(bins))
    return sqrt(max(between - (len(bins) - 1) * within / count, 0.0))


def extent_of(curves: Sequence[ResidualCurve], size: Size) -> float:
    """Choose how far up and down all plots of a component reach.

    Returns
    -------
    float
        [the residuals' unit]
    """
    bars: list[float] = [abs(b.mean) + _spread(b) for curve in curves for b in curve.bins]
    seen: float = min(largest(curve.residual for curve in curves), FAR_OUT * size.p95)
    noise: float = size.by_noise or 0.0
    return max([*bars, seen, STANDARD_DEVIATIONS * noise])


def curve_drawing(
    place: str, curve: ResidualCurve, size: Size, extent: float, moved: float
) -> Drawing:
    """Draw one curve.

    Parameters
    ----------
    extent
        How far the plot reaches up and down [the residuals' unit].
    """
    over, unit = curve.over, size.unit
    over_time, over_direction = over == TIME, over.startswith(DIRECTION)
    name = "time" if over_time else over.partition(" [")[0]
    x_title = "UTC" if over_time else over
    layout = layout_of(x_title, f"[{unit}]", extent, over_time=over_time)
    if over_direction:
        layout["xaxis"] |= {
            "tickvals": list(SIGNS.values()),
            "ticktext": list(SIGNS),
            "range": [-1.5, 1.5],
        }
    if size.by_noise:
        layout["shapes"] = [_band(STANDARD_DEVIATIONS * size.by_noise)]
    data: list[Json] = [_means(curve, over_time=over_time, is_line=not over_direction)]
    if curve.at:
        data.insert(0, _single(_places(curve.at, over_time, over_direction), curve.residual))
    figure = figure_text(moved, decimals_for(size.repeatability))
    alt_text = (
        f"Residuals of {component_name(size.component)} in {unit} over {name}, mean and scatter "
        f"in {len(curve.bins)} ranges: the means move by {figure} {unit}"
    )
    return Drawing(place, f"{name}: {figure} {unit}", alt_text, data, layout)


def _spread(one: Bin) -> float:
    """Standard deviation of the values in a bin."""
    return sqrt(max(one.rms**2 - one.mean**2, 0.0))


def _band(reach: float) -> Json:
    return {
        "type": "rect",
        "xref": "paper",
        "x0": 0,
        "x1": 1,
        "y0": -reach,
        "y1": reach,
        "fillcolor": BAND,
        "line": {"width": 0},
        "layer": "below",
    }


def _single(x: Sequence[Any], y: Sequence[float]) -> Json:
    return {
        "type": "scatter",
        "mode": "markers",
        "x": list(x),
        "y": list(y),
        "marker": {"color": POINTS, "size": 4, "opacity": 0.9 if len(y) < FEW else 0.45},
        "hovertemplate": "%{y}<extra></extra>",
        "name": "single values",
    }


def _places(at: Sequence[float], over_time: bool, over_direction: bool) -> Sequence[Any]:
    """Write where single values stand; those of one direction side by side, evenly."""
    if over_direction:
        return [_short(s + WIDE * (i * GOLDEN % 1.0 - 0.5)) for i, s in enumerate(at)]
    return dates(at) if over_time else at


def _means(curve: ResidualCurve, *, over_time: bool, is_line: bool) -> Json:
    """Means with their scatter, in the middle of each range."""
    bins = curve.bins
    middles = [SIGNS[b.label] if b.middle is None else b.middle for b in bins]
    names = [f"mean of {b.count}" for b in bins]
    return {
        "type": "scatter",
        "mode": "lines+markers" if is_line else "markers",
        "x": dates(middles) if over_time else [_short(m) for m in middles],
        "y": [_short(b.mean) for b in bins],
        "error_y": {
            "type": "data",
            "array": [_short(_spread(b)) for b in bins],
            "color": BEFORE,
            "thickness": 1.2,
            "width": 3,
        },
        "line": {"color": BEFORE, "width": 1.2},
        "marker": {"color": BEFORE, "size": 6},
        "name": "mean and standard deviation",
        **hover_texts(names),
    }


def _short(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
