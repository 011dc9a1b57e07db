"""Many collinear sensors and states, late, as one effect: what only all of them can say."""

from __future__ import annotations

from typing import Final

from app.effects.campaign_view import CampaignView
from app.effects.effect import Effect
from app.effects.kind import EffectKind, Proposed
from app.effects.words import MOST_NAMED
from app.errors import counted, list_names
from app.geometry.components import COMPONENTS

BEFORE, AFTER = "held_out_before", "held_out_after"
WORST_BEFORE, WORST_AFTER = "worst_before", "worst_after"
SET_UPS: Final = "set_ups"


class Response(EffectKind):
    """A component answers many sensors and states together, each late by several times.

    It is learnt from whole courses of set-ups beside the search, not among its candidates: none
    of its drivers by itself is what is found.
    """

    kind = "response"
    text = "many sensors and states act together with lags, and no single one of them can be named"
    measured_along = True
    only_once = True
    of_the_type = True
    shown_by = (
        "measure {component} every 10 min for some hours from a cold start, changing the room "
        "temperature in mid-run and the states in blocks, and repeat this on other days"
    )

    def propose(self, view: CampaignView) -> Proposed:
        """List nothing: the search has no part in it."""
        yield from ()

    def explain(self, effect: Effect) -> str:
        """Say what answers to what, and what set-ups held out gained."""
        code = effect.components[0]
        unit = COMPONENTS[code].unit
        symbol = unit.symbol
        figures = effect.parameters
        drivers = [*effect.sensors, *effect.states]
        named = list_names(drivers, MOST_NAMED)
        return (
            f"{code} responds to "
            f"{counted(len(drivers), 'sensor and state', 'sensors and states')} together "
            f"({named}), to each with several lags: over {figures[SET_UPS]:.0f} set-ups, each held "
            f"out in turn, its residual goes from {figures[f'{BEFORE}_{unit}']:.3g} to "
            f"{figures[f'{AFTER}_{unit}']:.3g} {symbol}; in the set-up that gains least, from "
            f"{figures[f'{WORST_BEFORE}_{unit}']:.3g} to "
            f"{figures[f'{WORST_AFTER}_{unit}']:.3g} {symbol}"
        )
