"""A slow change in time: wear, creep, settling."""

from __future__ import annotations

import numpy as np

from app.effects.campaign_view import OWN_ZEROS, CampaignView
from app.effects.driver import SinceReference
from app.effects.effect import Effect
from app.effects.kind import (
    EffectKind,
    Need,
    OverTime,
    Proposed,
    additive,
)
from app.effects.map_tables import times_of_maps
from app.effects.words import size_along, symbol_of

SINCE_MAPS, SINCE_FIRST = "since the maps", "since the first visit"


class Drift(EffectKind):
    """A component changes evenly with time, whatever the temperatures."""

    kind = "drift"
    text = "a change linear in time: wear, creep, settling"
    over_time = OverTime.GROWS
    of_time_alone = True
    measured_along = True
    drawn_over = "time"
    needs = Need.MOMENTS
    trending = True
    only_once = True
    shown_by = (
        "measure {component} again after a period as long as this campaign, at temperatures that "
        "occurred in it"
    )
    against = {
        "step": "measure {component} again after a period as long as this campaign: a drift will "
        "have gone on, a step will not",
        "thermal-lag": "measure {component} after a night of rest, at the same temperatures on two "
        "different days",
    }

    def propose(self, view: CampaignView) -> Proposed:
        """Every component, drifting since its maps or since the first visit."""
        for code in view.components:
            shapes = view.comparable_shapes(code, view.shapes(code))
            if not shapes:
                yield self.refuse(code, OWN_ZEROS)
                continue
            for variant, since_s in beginnings_s(view, code).items():
                yield additive(
                    *(self.kind, code, SinceReference(since_s), shapes, "drift_{unit}_per_day"),
                    variant=variant,
                )

    def explain(self, effect: Effect) -> str:
        """Say what drifts, and how fast."""
        how = size_along(effect, "drift", symbol_of(effect.components[0], "day"))
        return f"{effect.components[0]} has been drifting {effect.variant}, by {how}"


def beginnings_s(view: CampaignView, code: str) -> dict[str, float]:
    """Say from when a drift may count: it was not there yet in the maps, or not at first."""
    measured = times_of_maps(view.model, view.maps, code)
    return {
        SINCE_MAPS: float(np.mean(measured or [view.moments_s[0]])),
        SINCE_FIRST: float(view.moments_s[0]),
    }
