"""A component is not linear between the maps."""

from __future__ import annotations

from app.effects.campaign_view import CampaignView
from app.effects.driver import Curvature
from app.effects.effect import Effect
from app.effects.hypothesis import Hypothesis
from app.effects.kind import EffectKind, Need, Proposed, additive
from app.effects.words import size_along, symbol_of

BETWEEN, OVERALL = "between maps", "over all maps"


class TemperatureCurvature(EffectKind):
    """A parabola in the component's own temperature, zero where maps were measured."""

    kind = "temperature-curvature"
    text = "a component is not linear in temperature between the maps"
    zero_in_maps = True
    needs = Need.MOMENTS
    only_once = True
    of_the_type = True
    shown_by = (
        "measure {component} half way between the maps' temperatures of {sensor}: one more map "
        "there settles it"
    )
    against = {
        "outdated-map": "measure {component} at the temperature of one of the maps: a curved "
        "component is right there",
        "wrong-map": "measure {component} at the temperature of the map: a curved component is "
        "right there",
    }

    def propose(self, view: CampaignView) -> Proposed:
        """Every component with its own sensor: between neighbouring maps, and over all of them."""
        for code in view.components:
            sensor = view.sensor_of(code)
            if sensor not in view.varying_sensors:
                yield self.refuse(code, f"{sensor} did not change")
                continue
            scale = _scale(view, code)
            yield _hypothesis(view, code, OVERALL, (scale[0], scale[-1]))
            if len(scale) > 2:
                yield _hypothesis(view, code, BETWEEN, scale)

    def explain(self, effect: Effect) -> str:
        """Say how strongly what is curved in which temperature."""
        how = size_along(effect, "curvature", symbol_of(effect.components[0], "K²"))
        return (
            f"{effect.components[0]} is not linear in the temperature of {effect.sensors[0]} "
            f"{effect.variant}: its curvature is {how}"
        )


def _scale(view: CampaignView, code: str) -> tuple[float, ...]:
    """Give the maps' temperatures of a component's own sensor [°C]."""
    return next(g.scales[0].temperatures_c for g in view.model.groups if code in g.codes)


def _hypothesis(
    view: CampaignView, code: str, variant: str, scale: tuple[float, ...]
) -> Hypothesis:
    sensor = view.sensor_of(code)
    return additive(
        *(TemperatureCurvature.kind, code, Curvature(sensor, scale), view.shapes(code)),
        sizes="curvature_{unit}_per_k2",
        variant=variant,
        sensors=(sensor,),
    )
