"""Bending with the difference of two sensors, at once or late."""

from __future__ import annotations

from itertools import combinations
from typing import Final

import numpy as np

from app.effects.campaign_view import CampaignView
from app.effects.conditions import Signal
from app.effects.driver import Difference
from app.effects.effect import Effect
from app.effects.kind import (
    EffectKind,
    Need,
    Proposed,
    constant_sensors,
    not_late,
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

    kind = "sensor-gradient"
    text = "bending with the temperature difference between two sensors, at once or late"
    zero_in_maps = True
    needs = Need.MOMENTS
    only_once = True
    of_the_type = True
    shown_by = (
        "heat only one side of the structure, so that {sensor} differs from its neighbour as "
        "never before, and measure {component}"
    )
    against = {
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

    def propose(self, view: CampaignView) -> Proposed:
        """Every component with pairs of sensors, in two forms at once, and in one of them late.

        Late it is as it was in the maps, where they state both sensors: with both forms there
        would be more late differences than everything else together.
        """
        yield from constant_sensors(self, view)
        signals = [Signal("temperature", sensor) for sensor in view.varying_sensors]
        grids_s = dict.fromkeys(signals, tuple[float, ...]())
        if len(signals) > ALL_PAIRS_UP_TO:
            among = f"{len(view.varying_sensors)} sensors"
            reason = "pairs without the component's own sensor are left out: there are too many"
            yield self.refuse(among, reason)
            reason = "differences that act late are left out: there are too many"
            yield self.refuse(f"{among}, {LATE}", reason)
        else:
            grids_s = {signal: view.time_constants_s(signal) for signal in signals}
            yield from not_late(self, view, grids_s, LATE)
        for code in view.components:
            for pair in _pairs(view, code):
                drivers = {
                    SINCE: Difference(*pair, reference_k=_mean_k(view, pair)),
                    BEYOND: view.beyond_maps(code, *pair),
                }
                late = SINCE if drivers[BEYOND] is None else BEYOND
                first, other = (grids_s[Signal("temperature", sensor)] for sensor in pair)
                both_s = tuple(tau_s for tau_s in first if tau_s in other)
                yield from at_once_and_late(self.kind, view, code, drivers, both_s, [late])

    def explain(self, effect: Effect) -> str:
        """Say with which difference what moves, how late, and how much."""
        how = size_along(effect, "slope", symbol_of(effect.components[0], "K"))
        warm, cold = effect.sensors
        return (
            f"{effect.components[0]} bends with the difference between {warm} and "
            f"{cold}{how_late(effect)}, by {how}{since_maps_clause(effect)}"
        )


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
