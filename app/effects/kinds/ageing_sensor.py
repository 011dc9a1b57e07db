"""A sensor ages: its bias grows evenly with time."""

from __future__ import annotations

from app.effects.campaign_view import OWN_ZEROS, CampaignView
from app.effects.driver import SinceReference
from app.effects.effect import Effect
from app.effects.hypothesis import Amplitude, Hypothesis, moved_temperature
from app.effects.kind import EffectKind, Need, OverTime, Proposed
from app.effects.kinds.drift import beginnings_s
from app.effects.words import components
from app.units import plus_minus


class AgeingSensor(EffectKind):
    """A bias that grows since the maps, or since the first visit, in all components of a sensor.

    The sensor reads T where the machine has T − drift · days: measured minus predicted is
    E(T − drift · days) − E(T). The search takes the linear part; what is found and adopted moves
    the temperature, as with a bias (`sensor-fault`).
    """

    kind = "ageing-sensor"
    text = "a sensor's bias grows steadily with time"
    over_time = OverTime.GROWS
    measured_along = True
    drawn_over = "time"
    needs = Need.MOMENTS
    trending = True
    only_once = True
    shown_by = (
        "compare {sensor} with a calibrated thermometer placed beside it, now and again after a "
        "period as long as this campaign"
    )

    def propose(self, view: CampaignView) -> Proposed:
        """Every sensor that components follow, since the maps or since the first visit."""
        for sensor, codes in view.components_by_sensor.items():
            if not view.has_comparable_slope(codes):
                yield self.refuse(sensor, OWN_ZEROS)
                continue
            for variant, since_s in beginnings_s(view, codes[0]).items():
                yield _hypothesis(sensor, codes, variant, since_s)

    def explain(self, effect: Effect) -> str:
        """Say how fast it ages."""
        name = "bias_k_per_day"
        size = plus_minus(abs(effect.parameters[name]), effect.standard_errors.get(name), "K/day")
        way = "up" if effect.parameters[name] > 0.0 else "down"
        return (
            f"{effect.sensors[0]} ages: its reading has drifted {way} by {size} {effect.variant} "
            f"(seen in {components(effect)})"
        )

    def what_to_do(self, effect: Effect) -> str:
        """Say what to exchange."""
        return (
            f"Calibrate or replace {effect.sensors[0]}, then activate a version without the "
            "effect and measure the maps again."
        )


def _hypothesis(sensor: str, codes: tuple[str, ...], variant: str, since_s: float) -> Hypothesis:
    return Hypothesis(
        kind=AgeingSensor.kind,
        variant=variant,
        components=codes,
        sensors=(sensor,),
        amplitudes=(Amplitude("bias_k_per_day", -1.0),),
        **moved_temperature(codes, lambda _, k_per_day: SinceReference(since_s, k_per_day)),
    )
