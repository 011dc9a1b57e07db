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
from app.pages.wording import said_plainly


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
    y_title = said_plainly(f"residual [{curve.unit}]")
    layout = layout_of(_x_title(curve), y_title, extent, over_time=over_time)
    names = hover_texts([component_name(c) for c in curve.components])
    sides = curve.direction if _is_reversing(effect) else []
    subjects = list_names(map(component_name, dict.fromkeys(curve.components)), 3)
    drawings = []
    drawn = (
        ("before", "Before this effect", curve.before),
        ("after", "After this effect", curve.after),
    )
    for which, title, values in drawn:
        after = which == "after"
        trace = {**pointing(markers(x, values, after=after), sides, after=after), **names}
        data = [trace] if after else [trace, _says(x, curve.explained)]
        alt_text = (
            f"Residuals of {subjects} in {curve.unit} over {curve.over}, {which} this "
            f"effect: within ±{largest([values]):.3g} {curve.unit}, {len(x)} values"
        )
        drawings.append(Drawing(f"effect-{number}-{which}", title, alt_text, data, layout))
    return drawings


def caption(effect: FoundEffect) -> str:
    """Say how to read an effect's two figures, as plain text."""
    is_reversing, note = _is_reversing(effect), kind_of(effect.kind).driver_note
    shapes = (
        f"{'Open triangles' if is_reversing else 'Rings'}: measured minus predicted, with all "
        "other effects but without this one."
    )
    ways = "Triangles point the way of approach: up for plus, down for minus."
    rest = "Crosses: what this effect predicts. Filled: what is left with it."
    return " ".join(filter(None, (ways if is_reversing else "", shapes, rest, note)))


def _x_title(curve: EffectCurve) -> str:
    unit = "UTC" if curve.over == TIME else curve.over_unit
    over = said_plainly(str(curve.over))
    return f"{over} [{unit}]" if unit else over


def _is_reversing(effect: FoundEffect) -> bool:
    return any(term.is_reversing for term in effect.effect.terms)


def _says(x: Sequence[Any], explained: Sequence[float]) -> Json:
    """Crosses where the effect says that the residual is."""
    return {
        **markers(x, explained, after=True),
        "marker": {"color": INK, "symbol": "cross-thin-open", "size": 6, "line": {"width": 1.2}},
        "name": "what the effect says",
    }
