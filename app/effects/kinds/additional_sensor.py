"""A second sensor acts too."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from app.effects.campaign_view import CampaignView
from app.effects.driver import AboveReference, BeyondMaps
from app.effects.effect import Effect
from app.effects.hypothesis import Hypothesis
from app.effects.kind import (
    EffectKind,
    Need,
    Proposals,
    amplitudes_of,
    constant_sensors,
)
from app.effects.term import Term
from app.effects.words import size_along, symbol_of
from app.geometry.components import COMPONENTS

BEYOND, SINCE = "beyond the maps", "since the maps"
"""The sensor acted when the maps were measured, and they contain its part; or it did not."""


class AdditionalSensor(EffectKind):
    """A component moves with a second sensor as well, evenly or rising along its axis."""

    kind: ClassVar[str] = "additional-sensor"
    text: ClassVar[str] = "a second sensor acts on a component too"
    needs: ClassVar[frozenset[Need]] = frozenset({Need.MOMENTS})
    shown_by: ClassVar[str] = (
        "measure {component} while {sensor} changes and the assigned sensor stands still"
    )
    against: ClassVar[Mapping[str, str]] = {
        "additional-sensor": "bring {sensor} and {rival} apart, and measure {component} there",
        "sensor-gradient": "warm the whole machine evenly by the room, so that differences of "
        "sensors stay and {sensor} changes, and measure {component}",
        "state-variable": "warm {sensor} by the room with the spindle standing still, and "
        "measure {component} meanwhile",
    }

    def propose(self, view: CampaignView) -> Proposals:
        """Every component with every sensor that is not its own, in two forms."""
        found = Proposals(not_testable=constant_sensors(self, view))
        for code in view.components:
            for sensor in view.varying_sensors:
                if sensor != view.sensor_of(code):
                    beyond = view.beyond_maps(code, sensor)
                    since = AboveReference(sensor, view.reference_c(sensor))
                    found.hypotheses.append(_hypothesis(view, code, since, SINCE))
                    if beyond is not None:
                        found.hypotheses.append(_hypothesis(view, code, beyond, BEYOND))
        return found

    def explain(self, effect: Effect) -> str:
        """Say with which sensor what moves, and how much."""
        how = size_along(effect, "slope", symbol_of(effect.components[0], "K"))
        clause = since_maps_clause(effect)
        return f"{effect.components[0]} also moves with {effect.sensors[0]}, {how}{clause}"


def since_maps_clause(effect: Effect) -> str:
    """Say of an effect of the variant `SINCE` that it was not there when the maps were measured."""
    return ", as it did not when the maps were measured" if effect.variant == SINCE else ""


def _hypothesis(
    view: CampaignView, code: str, driver: BeyondMaps | AboveReference, variant: str
) -> Hypothesis:
    shapes = view.shapes(code)
    return Hypothesis(
        kind=AdditionalSensor.kind,
        variant=variant,
        components=(code,),
        sensors=(driver.sensor,),
        unit_terms=lambda _: [[Term(code, driver, shape)] for shape in shapes],
        amplitudes=amplitudes_of(shapes, f"slope_{COMPONENTS[code].unit}_per_k"),
    )
