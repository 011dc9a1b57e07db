"""A component follows another sensor than the one that it is assigned to."""

from __future__ import annotations

import numpy as np

from app.effects.campaign_view import CampaignView
from app.effects.driver import Always
from app.effects.effect import Effect
from app.effects.hypothesis import Hypothesis
from app.effects.kind import (
    EffectKind,
    Need,
    Proposed,
    constant_sensor_reason,
    together_and_each,
)
from app.effects.shape import Exchange
from app.effects.term import Term
from app.effects.words import SURELY, components, parameter, verb


class OtherSensor(EffectKind):
    """E of the same maps on another sensor's scale, minus E on the assigned one's."""

    kind = "other-sensor"
    text = "a component follows a sensor other than the assigned one"
    share_of = "of what the tables say that follows the other sensor: 1 for all of it, 0 for none"
    needs = Need.MOMENTS
    only_once = True
    of_the_type = True
    shown_by = (
        "create a temperature difference between {sensor} and the assigned sensor (heat only one "
        "part of the machine), and measure {component} in that state"
    )
    against = {
        "thermal-lag": (
            "hold {sensor} and the assigned sensor steady at different temperatures for some "
            "hours, and measure {component}: only a wrong sensor still leaves an error"
        ),
        "other-sensor": (
            "create a temperature difference between {sensor} and {rival}, and measure "
            "{component} in that state"
        ),
        "additional-sensor": (
            "keep {sensor} steady while the assigned sensor warms up, and measure {component}: "
            "if the assigned sensor is the wrong one, it does not move at all"
        ),
    }

    def propose(self, view: CampaignView) -> Proposed:
        """Every component on every other sensor, and all of a sensor together."""
        for assigned, codes in view.components_by_sensor.items():
            for other in view.conditions.temperatures_c:
                if other == assigned:
                    continue
                reason = _why_not(view, codes, other)
                if reason:
                    yield self.refuse(f"{assigned} by {other}", reason)
                    continue
                exchange = Exchange.of(other, view.map_temperatures(other))
                for group in together_and_each(codes):
                    yield _hypothesis(assigned, exchange, group)

    def explain(self, effect: Effect) -> str:
        """Say what follows which sensor, and by which share."""
        assigned, other = effect.sensors
        share = parameter(effect, "share")
        if effect.parameters["share"] <= 0.0:
            move = verb(effect.components, "moves", "move")
            return (
                f"{components(effect)} {move} the opposite way to what {other} says where it "
                f"differs from {assigned} (share {share})"
            )
        follow = verb(effect.components, "follows", "follow")
        return f"{components(effect)} {follow} {other} rather than {assigned} (share {share})"

    def doubt(self, effect: Effect) -> str:
        """What follows another sensor does so as a whole.

        That several components do so by one share, although their tables differ, is no chance.
        """
        share = effect.parameters.get("share", 1.0)
        error = effect.standard_errors.get("share", 0.0)
        if len(effect.components) > 1 or abs(share - 1.0) <= SURELY * error:
            return ""
        return (
            f"with a share of {share:.2g}, which is not 1, {effect.components[0]} follows neither "
            "sensor: something else may resemble what its tables say"
        )


def _hypothesis(assigned: str, exchange: Exchange, codes: tuple[str, ...]) -> Hypothesis:
    return Hypothesis(
        kind=OtherSensor.kind,
        components=codes,
        sensors=(assigned, exchange.sensor),
        unit_terms=lambda _: [[Term(code, Always(), exchange) for code in codes]],
    )


def _why_not(view: CampaignView, codes: tuple[str, ...], other: str) -> str:
    """Say why maps cannot be read on a sensor's scale, empty where they can."""
    if other not in view.varying_sensors:
        return constant_sensor_reason(other)
    in_maps_c = view.map_temperatures(other)
    labels = {label for code in codes if (f := view.model.find(code)) for label in f[0].labels}
    lacking = sorted(labels - set(in_maps_c))
    if lacking:
        return f"map {lacking[0]!r} does not state the temperature of {other}"
    gap_c = float(np.diff(np.sort([in_maps_c[label] for label in labels])).min())
    if not view.machine.sensor(other).resolves(gap_c):
        return f"two maps are only {gap_c:.2g} °C apart at {other}, too close for it to resolve"
    exchange = Exchange.of(other, in_maps_c)
    return next(filter(None, (exchange.why_missing(view.model, code) for code in codes)), "")
