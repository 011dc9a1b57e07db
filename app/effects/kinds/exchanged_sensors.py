"""Two sensors' plugs are exchanged: each reads what the other one should."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import Final

from app.arrays import FloatArray
from app.effects.campaign_view import CampaignView
from app.effects.effect import Effect
from app.effects.hypothesis import WHOLE, Hypothesis
from app.effects.kind import (
    EffectKind,
    Need,
    Proposed,
    Shakes,
    constant_sensors,
)
from app.effects.kinds.step import times_within
from app.effects.projection import Projection
from app.effects.supposition import left_by_temperatures, since
from app.effects.words import components
from app.units import date_text

SINCE_VISIT: Final = "since a visit"


class ExchangedSensors(EffectKind):
    """Each of two sensors has been read in the other's place: since the maps, or since some visit.

    Measured minus predicted is E(T_b) − E(T_a) for all components of sensor a and E(T_a) − E(T_b)
    for all of sensor b, on the scales that the maps state: one hypothesis without an amplitude.
    Exchanged while the maps were measured too, nothing is wrong but the names: that is
    `other-sensor`.
    """

    kind = "exchanged-sensors"
    text = "two sensors are swapped: each reads the temperature of the other's place"
    drawn_over = "time"
    share_of = "of what swapping the two readings would cause: 1 if they are swapped"
    needs = Need.MOMENTS
    only_once = True
    shown_by = "warm the place of {sensor} by hand for a minute, and see whose reading rises"
    not_adopted = (
        "it is a mistake in the wiring, not in the model: a correction would become wrong as "
        "soon as somebody puts the plugs right"
    )
    shakes = Shakes.TEMPERATURES

    def propose(self, view: CampaignView) -> Proposed:
        """Every pair of sensors of which components follow one at least.

        Since some visit, only pairs that both are followed: of others there are many, and what one
        sensor alone shows from some time on is its own fault as well.
        """
        yield from constant_sensors(self, view)
        times = times_within(view)
        for pair, codes in _pairs(view):
            always = Hypothesis(
                kind=self.kind,
                components=codes,
                sensors=pair,
                supposed=partial(_supposed, pair),
                expected=WHOLE,
            )
            yield always
            if times and all(sensor in view.components_by_sensor for sensor in pair):
                begun = since(partial(_supposed, pair))
                yield replace(always, variant=SINCE_VISIT, nonlinear=times, supposed=begun)

    def explain(self, effect: Effect) -> str:
        """Say which two are exchanged."""
        first, other = effect.sensors
        then = ""
        if effect.variant == SINCE_VISIT:
            then = f" since about {date_text(effect.parameters['changed_at_unix_s'])}"
        return (
            f"{first} and {other} are swapped{then}: each reads the temperature of the other's "
            f"place (seen in {components(effect)})"
        )

    def what_to_do(self, effect: Effect) -> str:
        """Say which plugs to swap."""
        first, other = effect.sensors
        return (
            f"Swap the plugs of {first} and {other}, or their names where readings are sent, then "
            "measure and analyse again: readings that are already stored stay swapped."
        )


def _pairs(view: CampaignView) -> Iterator[tuple[tuple[str, str], tuple[str, ...]]]:
    followed = view.components_by_sensor
    for first, other in combinations(view.varying_sensors, 2):
        codes = (*followed.get(first, ()), *followed.get(other, ()))
        if codes:
            yield (first, other), codes


def _supposed(pair: tuple[str, str], projection: Projection, theta: float | None) -> FloatArray:
    first, other = (projection.conditions.temperature(sensor) for sensor in pair)
    return left_by_temperatures(projection, {pair[0]: other - first, pair[1]: first - other})
