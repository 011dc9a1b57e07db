"""One map of a component is wrong: something was amiss while it was measured."""

from __future__ import annotations

from app.effects.campaign_view import OWN_ZEROS, CampaignView
from app.effects.driver import ShareOfMap
from app.effects.effect import Effect
from app.effects.kind import (
    EffectKind,
    Need,
    Proposed,
    additive,
    constant_sensor_reason,
)
from app.effects.kinds.outdated_map import forms_of, how_far_off
from app.thermal.error_map import ErrorMap

BEFORE_FORM = ": "
"""Between the map's label and the form in which it is off."""


class WrongMap(EffectKind):
    """The same deviation from one map, as far as tables are made of it.

    A door that stood open, an instrument that was not warm, a workpiece in the way: it fades
    towards the neighbouring maps as the map's weight does.
    """

    kind = "wrong-map"
    text = "one map of a component is wrong, the others hold"
    gone = "its map is gone, or counts as one state with another map"
    needs = Need.MOMENTS
    shown_by = "measure the map of {component} again"
    against = {
        "wrong-map": "measure the maps of {component} again, one after the other",
        "outdated-map": "measure {component} at the temperature of another map: one that is wrong "
        "alone does not show there",
        "temperature-curvature": "measure {component} at the temperature of the map: a curved "
        "component is right there",
    }

    def propose(self, view: CampaignView) -> Proposed:
        """Every map of every component whose sensor changed, in all forms."""
        for code in view.components:
            shapes = view.comparable_shapes(code, view.shapes(code))
            located, sensor = view.model.find(code), view.sensor_of(code)
            if not shapes:
                yield self.refuse(code, OWN_ZEROS)
            if located is not None and sensor not in view.varying_sensors:
                yield self.refuse(code, constant_sensor_reason(sensor))
            if located is None or not shapes or sensor not in view.varying_sensors:
                continue
            group, scale = located[0], located[0].scales[0]
            for row, map_c in zip(scale.rows, scale.temperatures_c, strict=True):
                share = ShareOfMap(scale.sensor, scale.temperatures_c, map_c)
                for form in forms_of(view, code, shapes):
                    yield additive(
                        *(self.kind, code, share, form.shapes, form.amplitudes),
                        variant=f"{group.labels[row]}{BEFORE_FORM}{form.name}",
                        sensors=(share.sensor,),
                    )

    def explain(self, effect: Effect) -> str:
        """Say which map is wrong, and how far."""
        label, form = _label_and_form(effect.variant)
        return (
            f"map {label!r} of {effect.components[0]} is wrong, while its other maps hold: it is "
            f"{how_far_off(effect, form)} (seen over {effect.sensors[0]})"
        )

    def which_map(self, variant: str) -> str:
        """Give the map's label."""
        return _label_and_form(variant)[0]

    def what_to_do(self, effect: Effect) -> str:
        """Say which map to measure again."""
        code, label = effect.components[0], self.which_map(effect.variant)
        return f"Measure {code} of map {label!r} again; until then the correction may be adopted."

    def is_measured_along(self, new_map: ErrorMap, effect: Effect) -> bool:
        """Whether the map is of the temperature of the one that is wrong."""
        (of_map,) = {t.driver for t in effect.terms if isinstance(t.driver, ShareOfMap)}
        return new_map.temperatures_c.get(of_map.sensor) == of_map.map_c


def _label_and_form(variant: str) -> tuple[str, str]:
    label, _, form = variant.rpartition(BEFORE_FORM)
    return label, form
