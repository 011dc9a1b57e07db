"""Roll, pitch or yaw that the maps lack: it acts through the lever arms and the tool offset."""

from __future__ import annotations

from collections.abc import Iterable

from app.effects.campaign_view import CampaignView
from app.effects.effect import Effect
from app.effects.kinds.constant_or_warm import LackedByMaps
from app.effects.words import size_along, symbol_of
from app.geometry.components import Kind


class Angular(LackedByMaps):
    """A rotation of an axis that no map has, constant in time or growing with a temperature."""

    kind = "angular"
    text = "a roll, pitch or yaw error that the maps lack"
    of = Kind.ANGULAR
    name = "rotation"
    size = "angle"
    shown_by = (
        "measure the same points with a short and a long tool, or measure {component} itself "
        "with a level or an angular interferometer"
    )
    against = {
        "nonrigid-slope": (
            "measure the same points with a short and a long tool: the effect of a rotation "
            "grows with the tool, that of a slope does not"
        ),
        "angular": "measure lines along all three axes with a short and a long tool: each "
        "rotation has its own lever arms",
    }

    def may_grow_with(self, view: CampaignView, code: str) -> Iterable[str]:
        """Any sensor that changed."""
        return view.varying_sensors

    def explain(self, effect: Effect) -> str:
        """Say what turns, and by how much."""
        code = effect.components[0]
        if not effect.sensors:
            how = size_along(effect, "angle", symbol_of(code))
            return f"{code}, which the maps lack, rotates the tool by {how}"
        how = size_along(effect, "slope", symbol_of(code, "K"))
        return f"{code}, which the maps lack, changes with {effect.sensors[0]}, by {how}"
