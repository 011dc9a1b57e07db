"""An effect's residuals over what drives it: before with what the effect says, and after."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from app.effects.registry import kind_of
from app.errors import list_names
from app.identification.analysis.found_effect import FoundEffect
from app.identification.analysis.plots import EffectCurve
from app.pages.report_parts.component_names import component_name
from app.pages.report_parts.drawing import (
    INK,
    TIME,
    Drawing,
    Json,
    dates,
    hover_texts,
    largest,
    layout_of,
    markers,
    pointing,
)


def effect_drawings(number: int, effect: FoundEffect, curve: EffectCurve) -> list[Drawing]:
    """Draw an effect's residuals before and after over its driver.

    Parameters
    ----------
    curve
        Its arrays: driver, before, after, explained, direction, components.

    Returns
    -------
    list of Drawing
        Two with the same scales; none where there is nothing to draw.
    """
    if not curve.driver:
        return []
    over_time = curve.over == TIME
    x = dates(curve.driver) if over_time else curve.driver
    extent = largest([curve.before, curve.after, curve.explained])
    layout = layout_of(_x_title(curve), f"residual [{curve.unit}]", extent, over_time=over_time)
    names = hover_texts([component_name(c) for c in curve.components])
    sides = curve.direction if _is_reversing(effect) else []
    subjects = list_names(map(component_name, dict.fromkeys(curve.components)), 3)
    drawings = []
    for which, values in (("before", curve.before), ("after", curve.after)):
        after = which == "after"
        trace = {**pointing(markers(x, values, after=after), sides, after=after), **names}
        data = [trace] if after else [trace, _says(x, curve.explained)]
        alt_text = (
            f"Residuals of {subjects} in {curve.unit} over {curve.over}, {which} this "
            f"effect: within ±{largest([values]):.3g} {curve.unit}, {len(x)} values"
        )
        title = f"{which.capitalize()} this effect"
        drawings.append(Drawing(f"effect-{number}-{which}", title, alt_text, data, layout))
    return drawings


def caption(effect: FoundEffect) -> str:
    """Say how to read an effect's two figures, as plain text."""
    shapes = (
        "Triangles point the way of approach: up for plus, down for minus. Open"
        if _is_reversing(effect)
        else "Rings"
    )
    note = kind_of(effect.kind).driver_note
    return (
        f"{shapes}: measured minus predicted, with all other effects but without this one. "
        "Crosses: what this effect predicts. Filled: what is left with it."
        + (f" {note}" if note else "")
    )


def _x_title(curve: EffectCurve) -> str:
    unit = "UTC" if curve.over == TIME else curve.over_unit
    return f"{curve.over} [{unit}]" if unit else str(curve.over)


def _is_reversing(effect: FoundEffect) -> bool:
    return any(term.is_reversing for term in effect.effect.terms)


def _says(x: Sequence[Any], explained: Sequence[float]) -> Json:
    """Crosses where the effect says that the residual is."""
    return {
        **markers(x, explained, after=True),
        "marker": {"color": INK, "symbol": "cross-thin-open", "size": 6, "line": {"width": 1.2}},
        "name": "what the effect says",
    }
