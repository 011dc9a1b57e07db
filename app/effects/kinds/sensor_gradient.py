"""Bending with the difference of two sensors, at once or late."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import ClassVar, Final

import numpy as np

from app.effects.campaign_view import CampaignView
from app.effects.conditions import Signal
from app.effects.driver import Difference
from app.effects.effect import Effect
from app.effects.kind import (
    AsOtherSensor,
    EffectKind,
    Need,
    NotTested,
    Proposals,
    constant_sensors,
    time_constants_s,
)
from app.effects.kinds.at_once_or_late import (
    BEYOND,
    LATE,
    SINCE,
    at_once_and_late,
    how_late,
    since_maps_clause,
)
from app.effects.words import size_along, symbol_of

ALL_PAIRS_UP_TO: Final = 8
"""Of more sensors than this, only pairs with the component's own are tried, and those at once."""


class SensorGradient(EffectKind):
    """A component moves with how much warmer one place is than another."""

    kind: ClassVar[str] = "sensor-gradient"
    text: ClassVar[str] = (
        "bending with the temperature difference between two sensors, at once or late"
    )
    as_other_sensor: ClassVar[AsOtherSensor] = AsOtherSensor.IMITATION
    zero_in_maps: ClassVar[bool] = True
    needs: ClassVar[frozenset[Need]] = frozenset({Need.MOMENTS})
    only_once: ClassVar[bool] = True
    of_the_type: ClassVar[bool] = True
    shown_by: ClassVar[str] = (
        "heat only one side of the structure, so that {sensor} differs from its neighbour as "
        "never before, and measure {component}"
    )
    against: ClassVar[Mapping[str, str]] = {
        "thermal-lag": (
            "keep the difference steady for some hours (a run at constant speed) and measure "
            "{component}: a lagging structure is right again, a bent one is not"
        ),
        "additional-sensor": (
            "warm the whole machine evenly by heating the room, so that the differences do not "
            "change, and measure {component}: what bends with a difference does not move"
        ),
        "state-variable": (
            "measure {component} while the spindle coasts down after a run: the temperature "
            "difference outlasts the spindle's speed"
        ),
    }

    def propose(self, view: CampaignView) -> Proposals:
        """Every component with pairs of sensors, in two forms at once, and in one of them late.

        Late it is as it was in the maps, where they state both sensors: with both forms there
        would be more late differences than everything else together.
        """
        proposals = Proposals(not_testable=constant_sensors(self, view))
        if len(view.varying_sensors) > ALL_PAIRS_UP_TO:
            proposals.not_testable.extend(self._refused_pairs(view))
        grids = self._time_constants_s(view, proposals)
        for code in view.components:
            for pair in _pairs(view, code):
                drivers = {
                    SINCE: Difference(*pair, reference_k=_mean_k(view, pair)),
                    BEYOND: view.beyond_maps(code, *pair),
                }
                late = SINCE if drivers[BEYOND] is None else BEYOND
                both_s = tuple(tau_s for tau_s in grids[pair[0]] if tau_s in grids[pair[1]])
                proposals.hypotheses.extend(
                    at_once_and_late(self.kind, view, code, drivers, both_s, [late])
                )
        return proposals

    def explain(self, effect: Effect) -> str:
        """Say with which difference what moves, how late, and how much."""
        how = size_along(effect, "slope", symbol_of(effect.components[0], "K"))
        warm, cold = effect.sensors
        return (
            f"{effect.components[0]} bends with the difference between {warm} and "
            f"{cold}{how_late(effect)}, by {how}{since_maps_clause(effect)}"
        )

    def _time_constants_s(
        self, view: CampaignView, proposals: Proposals
    ) -> dict[str, tuple[float, ...]]:
        """List for each sensor the time constants to try [s], and say why there are none."""
        if len(view.varying_sensors) > ALL_PAIRS_UP_TO:
            return dict.fromkeys(view.varying_sensors, ())
        return {
            sensor: time_constants_s(self, view, Signal("temperature", sensor), proposals, LATE)
            for sensor in view.varying_sensors
        }

    def _refused_pairs(self, view: CampaignView) -> list[NotTested]:
        among = f"{len(view.varying_sensors)} sensors"
        return [
            self.refuse(
                among, "pairs without the component's own sensor are left out: there are too many"
            ),
            self.refuse(
                f"{among}, {LATE}", "differences that act late are left out: there are too many"
            ),
        ]


def _pairs(view: CampaignView, code: str) -> list[tuple[str, str]]:
    sensors = view.varying_sensors
    if len(sensors) <= ALL_PAIRS_UP_TO:
        return list(combinations(sensors, 2))
    assigned = view.sensor_of(code)
    return (
        [(other, assigned) for other in sensors if other != assigned] if assigned in sensors else []
    )


def _mean_k(view: CampaignView, pair: tuple[str, str]) -> float:
    """The difference in the maps on average, or else in the campaign."""
    in_maps_c = [view.map_temperatures(sensor) for sensor in pair]
    both = [
        in_maps_c[0][label] - in_maps_c[1][label] for label in in_maps_c[0] if label in in_maps_c[1]
    ]
    temperature = view.conditions.temperature
    return float(np.mean(both or np.nanmean(temperature(pair[0]) - temperature(pair[1]))))
