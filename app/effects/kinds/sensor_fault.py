"""A sensor reads wrong from some time on.

A bias is found in the residuals. A sensor that stands still, or spikes, is found among the
readings themselves (`app.identification.analysis.reading_faults`), which are left out before.
"""

from __future__ import annotations

from typing import Final

from app.effects.campaign_view import OWN_ZEROS, CampaignView
from app.effects.driver import StepAfter
from app.effects.effect import Effect
from app.effects.hypothesis import Amplitude, Hypothesis, moved_temperature
from app.effects.kind import EffectKind, Need, Proposed
from app.effects.kinds.step import NONE_BEFORE, times_after_first
from app.effects.words import components, parameter
from app.units import date_text

BIAS, STUCK, SPIKES = "bias", "stuck", "spikes"

CONSTANT_BIAS: Final = (
    "a bias that existed before the campaign and does not change is already in the tables: it "
    "cannot be told from an outdated map"
)


class SensorFault(EffectKind):
    """A bias from some visit on: it moves all of the sensor's components at once.

    The sensor reads T where the machine has T − bias: measured minus predicted is
    E(T − bias) − E(T). The search takes the linear part of it, −bias · dE/dT; what is found and
    adopted moves the temperature, which is right also where a map lies between.
    """

    kind = "sensor-fault"
    text = "a sensor reads wrong from some time on"
    drawn_over = "time"
    needs = Need.MOMENTS
    trending = True
    shown_by = "compare {sensor} with a calibrated thermometer placed beside it"

    def propose(self, view: CampaignView) -> Proposed:
        """One fingerprint for each sensor that components follow."""
        yield self.refuse("constant bias", CONSTANT_BIAS)
        for sensor, codes in view.components_by_sensor.items():
            if not view.has_comparable_slope(codes):
                yield self.refuse(sensor, OWN_ZEROS)
                continue
            nonlinear = times_after_first(view, codes)
            if nonlinear is None:
                yield self.refuse(sensor, NONE_BEFORE)
                continue
            yield Hypothesis(
                kind=self.kind,
                variant=BIAS,
                components=codes,
                sensors=(sensor,),
                amplitudes=(Amplitude("bias_k", -1.0),),
                nonlinear=nonlinear,
                # One component by itself moves as an instrument does whose zero walks.
                keeps_zero=len(codes) > 1,
                **moved_temperature(
                    codes, lambda theta, bias_k: StepAfter(float(theta or 0.0), bias_k)
                ),
            )

    def explain(self, effect: Effect) -> str:
        """Say which sensor reads wrong since when, and by how much."""
        if effect.variant in (STUCK, SPIKES):
            return _of_readings(effect)
        bias = parameter(effect, "bias_k", "K")
        since = date_text(effect.parameters["changed_at_unix_s"])
        return (
            f"{effect.sensors[0]} has read wrong by {bias} since about {since} (seen in "
            f"{components(effect)})"
        )

    def may_be_instruments(self, effect: Effect) -> bool:
        """Whether it is a bias that one component alone shows, as a step of it would."""
        return effect.variant == BIAS and len(effect.components) == 1


def _of_readings(effect: Effect) -> str:
    """Say what the readings themselves show."""
    sensor, parameters = effect.sensors[0], effect.parameters
    since = date_text(parameters["changed_at_unix_s"])
    if effect.variant == STUCK:
        return f"{sensor} was stuck for {parameters['lasted_h']:.0f} h from {since} on"
    return (
        f"{sensor} has jumped by {abs(parameters['spike_k']):.1f} K in {parameters['share']:.1%} "
        f"of its readings since {since}"
    )
