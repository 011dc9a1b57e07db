"""A component grows with another axis' position: the machine is not rigid."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from app.geometry.components import COMPONENTS, Component, Kind
from app.identification.effects.driver import AboveReference, Always, Driver
from app.identification.effects.effect import Effect
from app.identification.effects.hypothesis import Hypothesis
from app.identification.effects.kind import EffectKind, Need, Proposals, amplitudes_of
from app.identification.effects.site import Site
from app.identification.effects.term import Term
from app.identification.effects.words import parameter, strongest, symbol_of, where

CONSTANT, WITH_TEMPERATURE = "constant", "with temperature"


class NonrigidSlope(EffectKind):
    """A slope of 8.1–8.18 that no map has, constant in time or growing with a temperature."""

    kind: ClassVar[str] = "nonrigid-slope"
    text: ClassVar[str] = "a component grows with another axis' position"
    needs: ClassVar[frozenset[Need]] = frozenset({Need.POINTS})
    shown_by: ClassVar[str] = (
        "measure the axis of {component} along three parallel lines: at both ends and in the "
        "middle of the other axis, with the same tool"
    )
    against: ClassVar[Mapping[str, str]] = {
        "angular": "measure the same points with a short and a long tool: a rotation grows with "
        "the tool, a slope does not",
    }

    def propose(self, site: Site) -> Proposals:
        """Every slope that the model lacks and that shows at some point."""
        found = Proposals()
        lacking = [
            c
            for c in COMPONENTS.values()
            if c.kind is Kind.SLOPE and c.code not in site.in_model and site.shows(c.code)
        ]
        if not lacking:
            found.not_testable.append(self.refuse("", "the maps have all slopes that show"))
        for component in lacking:
            found.hypotheses.append(_hypothesis(site, component, None))
            sensor = site.sensor_of(component.code.partition("^")[0])
            if sensor in site.varying_sensors:
                found.hypotheses.append(_hypothesis(site, component, sensor))
        return found

    def explain(self, effect: Effect) -> str:
        """Say what grows with which axis, and how much."""
        component = COMPONENTS[effect.components[0]]
        parent, axis = component.code.partition("^")[0], str(component.times).upper()
        name = strongest(effect, "slope")
        how = parameter(effect, name, symbol_of(component.code, "K" if effect.sensors else ""))
        warm = f" and {effect.sensors[0]}" if effect.sensors else ""
        return f"{parent} grows with the position of {axis}{warm}, {how}{where(name)}"


def _hypothesis(site: Site, component: Component, sensor: str | None) -> Hypothesis:
    code = component.code
    driver: Driver = Always()
    if sensor is not None:
        driver = AboveReference(sensor, site.reference_c(sensor))
    shapes = site.shapes(code)
    per = "_per_k" if sensor else ""
    return Hypothesis(
        kind=NonrigidSlope.kind,
        variant=CONSTANT if sensor is None else WITH_TEMPERATURE,
        components=(code,),
        sensors=() if sensor is None else (sensor,),
        unit_terms=lambda _: [[Term(code, driver, shape)] for shape in shapes],
        amplitudes=amplitudes_of(shapes, f"slope_{component.unit}{per}"),
        is_within_visit=sensor is None,
    )
