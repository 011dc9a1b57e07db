"""Bending with the difference of two sensors."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import ClassVar, Final

import numpy as np

from app.effects.campaign_view import CampaignView
from app.effects.driver import BeyondMaps, Difference
from app.effects.effect import Effect
from app.effects.hypothesis import Hypothesis
from app.effects.kind import (
    EffectKind,
    Need,
    NotTested,
    Proposals,
    amplitudes_of,
    constant_sensors,
)
from app.effects.kinds.additional_sensor import BEYOND, SINCE, since_maps_clause
from app.effects.term import Term
from app.effects.words import size_along, symbol_of
from app.geometry.components import COMPONENTS

ALL_PAIRS_UP_TO: Final = 8
"""Of more sensors than this, only pairs with the component's own are tried."""


class SensorGradient(EffectKind):
    """A component moves with how much warmer one place is than another."""

    kind: ClassVar[str] = "sensor-gradient"
    text: ClassVar[str] = "bending with the difference of two sensors"
    needs: ClassVar[frozenset[Need]] = frozenset({Need.MOMENTS})
    only_once: ClassVar[bool] = True
    shown_by: ClassVar[str] = (
        "heat one side of the structure only, so that {sensor} differs from its neighbour as "
        "never before, and measure {component}"
    )
    against: ClassVar[Mapping[str, str]] = {
        "thermal-lag": "keep the difference steady for some hours (a run at constant speed) and "
        "measure {component}: a late structure is right again, a bent one is not",
        "additional-sensor": "warm the whole machine evenly by the room, so that differences "
        "stay, and measure {component}: what bends does not move",
        "state-variable": "measure {component} in the coasting-down after a run: the difference "
        "outlasts the spindle's speed",
    }

    def propose(self, view: CampaignView) -> Proposals:
        """Every component with pairs of sensors, in two forms."""
        found = Proposals(not_testable=constant_sensors(self, view))
        if len(view.varying_sensors) > ALL_PAIRS_UP_TO:
            found.not_testable.append(self._refused_pairs(view))
        for code in view.components:
            for pair in _pairs(view, code):
                beyond = view.beyond_maps(code, *pair)
                since = Difference(*pair, reference_k=_mean_k(view, pair))
                found.hypotheses.append(_hypothesis(view, code, since, SINCE))
                if beyond is not None:
                    found.hypotheses.append(_hypothesis(view, code, beyond, BEYOND))
        return found

    def explain(self, effect: Effect) -> str:
        """Say with which difference what moves, and how much."""
        how = size_along(effect, "slope", symbol_of(effect.components[0], "K"))
        warm, cold = effect.sensors
        return (
            f"{effect.components[0]} bends with the difference of {warm} and {cold}, "
            f"{how}{since_maps_clause(effect)}"
        )

    def _refused_pairs(self, view: CampaignView) -> NotTested:
        return self.refuse(
            f"{len(view.varying_sensors)} sensors",
            "pairs without a component's own sensor are left out: they are too many",
        )


def _pairs(view: CampaignView, code: str) -> list[tuple[str, str]]:
    sensors = view.varying_sensors
    if len(sensors) <= ALL_PAIRS_UP_TO:
        return list(combinations(sensors, 2))
    own = view.sensor_of(code)
    return [(other, own) for other in sensors if other != own] if own in sensors else []


def _mean_k(view: CampaignView, pair: tuple[str, str]) -> float:
    """The difference in the maps on average, or else in the campaign."""
    stated = [view.map_temperatures(sensor) for sensor in pair]
    both = [stated[0][label] - stated[1][label] for label in stated[0] if label in stated[1]]
    temperature = view.conditions.temperature
    return float(np.mean(both or np.nanmean(temperature(pair[0]) - temperature(pair[1]))))


def _hypothesis(
    view: CampaignView, code: str, driver: BeyondMaps | Difference, variant: str
) -> Hypothesis:
    shapes = view.shapes(code)
    return Hypothesis(
        kind=SensorGradient.kind,
        variant=variant,
        components=(code,),
        sensors=(driver.sensor, driver.minus),
        unit_terms=lambda _: [[Term(code, driver, shape)] for shape in shapes],
        amplitudes=amplitudes_of(shapes, f"slope_{COMPONENTS[code].unit}_per_k"),
    )
