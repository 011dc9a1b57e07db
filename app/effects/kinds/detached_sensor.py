"""A sensor came half off: it reads something between its body and what surrounds it."""

from __future__ import annotations

from typing import Final

from app.effects.campaign_view import CampaignView
from app.effects.driver import Difference
from app.effects.effect import Effect
from app.effects.hypothesis import Estimate, Hypothesis, Reported, moved_temperature
from app.effects.kind import EffectKind, Need, Proposed
from app.effects.words import components, parameter
from app.search.candidate import Expected

BETWEEN: Final = Expected((0.25, 1.0), 0.5)
"""(1 − share) / share of sensors that read 80 % or half of their body, and around them: never
below 0, which no surroundings can do."""

MOST_OVERSHOT: Final = 0.9
"""Beyond it a share means nothing any more."""


class DetachedSensor(EffectKind):
    """The sensor reads share · T_body + (1 − share) · T_around since the maps were measured.

    The body is then at T + (T − T_around)(1 − share)/share: measured minus predicted is the maps
    there minus the maps at T, in all components of the sensor. The search takes the linear part;
    what is found and adopted moves the temperature.
    """

    kind = "detached-sensor"
    text = "a sensor reads a mix of its body's temperature and that of its surroundings"
    measured_along = True
    drawn_over = "time"
    share_of = "of its body's temperature in the reading"
    needs = Need.MOMENTS
    only_once = True
    shown_by = (
        "press a second thermometer onto the body beside the sensor that {component} follows, "
        "while that body is much warmer than {sensor}"
    )

    def propose(self, view: CampaignView) -> Proposed:
        """Every sensor that components follow, with each that may say what surrounds it."""
        followed = view.components_by_sensor
        around = [s for s in view.varying_sensors if s not in followed] or view.varying_sensors
        for sensor, codes in followed.items():
            for other in around if sensor in view.varying_sensors else ():
                if other != sensor:
                    yield _hypothesis(sensor, other, codes)

    def explain(self, effect: Effect) -> str:
        """Say between what it reads."""
        sensor, around = effect.sensors
        share = parameter(effect, "share")
        return (
            f"{sensor} reads a mix of its body's temperature (share {share}) and that of "
            f"{around}, as if it had come loose (seen in {components(effect)})"
        )

    def what_to_do(self, effect: Effect) -> str:
        """Say what to fasten."""
        return (
            f"Fasten {effect.sensors[0]} to its body and shield it from its surroundings; then "
            "activate a version without the effect, and measure again."
        )


def _hypothesis(sensor: str, around: str, codes: tuple[str, ...]) -> Hypothesis:
    return Hypothesis(
        kind=DetachedSensor.kind,
        components=codes,
        sensors=(sensor, around),
        expected=BETWEEN,
        report=_reported,
        **moved_temperature(
            codes, lambda _, times: Difference(sensor, around, reference_k=0.0, height=times)
        ),
    )


def _reported(estimate: Estimate) -> Reported:
    """Give the share of the body, 1 / (1 + k)."""
    # T = s B + (1 − s) A, so the body is at B = T + k (T − A) with k = (1 − s)/s; ds/dk = −s².
    k, variance = float(estimate.coefficients[0]), float(estimate.covariance[0, 0])
    share = 1.0 / (1.0 + max(k, -MOST_OVERSHOT))
    return Reported({"share": share}, {"share": variance**0.5 * share**2})
