"""One map of a component is wrong: something was amiss while it was measured."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import ClassVar

from app.effects.campaign_view import CampaignView
from app.effects.driver import ShareOfMap
from app.effects.effect import Effect
from app.effects.hypothesis import Hypothesis
from app.effects.kind import (
    DrawnOver,
    EffectKind,
    Need,
    Proposals,
    additive,
    by_comparable_shapes,
    constant_sensor_reason,
)
from app.effects.kinds.outdated_map import forms_of, how_far_off
from app.effects.shape import Shape
from app.thermal.error_map import ErrorMap

BEFORE_FORM = ": "
"""Between the map's label and the form in which it is off."""


class WrongMap(EffectKind):
    """The same deviation from one map, as far as tables are made of it.

    A door that stood open, an instrument that was not warm, a workpiece in the way: it fades
    towards the neighbouring maps as the map's weight does.
    """

    kind: ClassVar[str] = "wrong-map"
    text: ClassVar[str] = "one map of a component is wrong, the others hold"
    gone: ClassVar[str] = "its map is gone, or counts as one state with another map"
    needs: ClassVar[frozenset[Need]] = frozenset({Need.MOMENTS})
    drawn_over: ClassVar[DrawnOver] = "driver"
    shown_by: ClassVar[str] = "measure the map of {component} again"
    against: ClassVar[Mapping[str, str]] = {
        "wrong-map": "measure the maps of {component} again, one after the other",
        "outdated-map": "measure {component} at the temperature of another map: one that is wrong "
        "alone does not show there",
        "temperature-curvature": "measure {component} at the temperature of the map: a curved "
        "component is right there",
    }

    def propose(self, view: CampaignView) -> Proposals:
        """Every map of every component whose sensor changed, in all forms."""

        def of_component(code: str, shapes: list[Shape]) -> Iterable[Hypothesis]:
            located = view.model.find(code)
            if located is None or view.sensor_of(code) not in view.varying_sensors:
                return
            group, scale = located[0], located[0].scales[0]
            for row, map_c in zip(scale.rows, scale.temperatures_c, strict=True):
                share = ShareOfMap(scale.sensor, scale.temperatures_c, map_c)
                for form in forms_of(view, code, shapes):
                    yield additive(
                        *(self.kind, code, share, form.shapes, form.amplitudes),
                        variant=f"{group.labels[row]}{BEFORE_FORM}{form.name}",
                        sensors=(share.sensor,),
                    )

        proposals = by_comparable_shapes(self, view, of_component)
        for code in view.components:
            sensor = view.sensor_of(code)
            if view.model.find(code) and sensor not in view.varying_sensors:
                proposals.not_testable.append(self.refuse(code, constant_sensor_reason(sensor)))
        return proposals

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
