"""A component grows with another axis' position: the machine is not rigid."""

from __future__ import annotations

from collections.abc import Iterable

from app.effects.campaign_view import CampaignView
from app.effects.effect import Effect
from app.effects.kinds.constant_or_warm import LackedByMaps
from app.effects.words import size_along, symbol_of
from app.geometry.components import COMPONENTS, Kind


class NonrigidSlope(LackedByMaps):
    """A slope of 8.1–8.18 that no map has, constant in time or growing with a temperature."""

    kind = "nonrigid-slope"
    text = "a component grows with the position of another axis"
    of = Kind.SLOPE
    name = "slope"
    size = "slope"
    shown_by = (
        "measure the axis of {component} along three parallel lines: at both ends and in the "
        "middle of the other axis, with the same tool"
    )
    against = {
        "angular": "measure the same points with a short and a long tool: the effect of a rotation "
        "grows with the tool, that of a slope does not",
    }

    def may_grow_with(self, view: CampaignView, code: str) -> Iterable[str]:
        """The sensor of the component of which it is the slope."""
        assigned = view.sensor_of(code.partition("^")[0])
        return [assigned] if assigned in view.varying_sensors else []

    def explain(self, effect: Effect) -> str:
        """Say what grows with which axis, and how much."""
        component = COMPONENTS[effect.components[0]]
        parent, axis = component.code.partition("^")[0], str(component.times).upper()
        how = size_along(effect, "slope", symbol_of(component.code, "K" if effect.sensors else ""))
        warm = f" and {effect.sensors[0]}" if effect.sensors else ""
        return f"{parent} grows with the position of {axis}{warm}, by {how}"
