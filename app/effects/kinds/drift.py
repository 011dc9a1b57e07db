"""A slow change in time: wear, creep, settling."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import ClassVar

import numpy as np

from app.effects.campaign_view import CampaignView
from app.effects.driver import SinceReference
from app.effects.effect import Effect
from app.effects.hypothesis import Hypothesis
from app.effects.kind import (
    DrawnOver,
    EffectKind,
    Need,
    OverTime,
    Proposals,
    additive,
    by_comparable_shapes,
)
from app.effects.map_tables import times_of_maps
from app.effects.shape import Shape
from app.effects.words import size_along, symbol_of

SINCE_MAPS, SINCE_FIRST = "since the maps", "since the first visit"


class Drift(EffectKind):
    """A component changes evenly with time, whatever the temperatures."""

    kind: ClassVar[str] = "drift"
    text: ClassVar[str] = "a change linear in time: wear, creep, settling"
    over_time: ClassVar[OverTime | None] = OverTime.GROWS
    of_time_alone: ClassVar[bool] = True
    measured_along: ClassVar[bool] = True
    drawn_over: ClassVar[DrawnOver] = "time"
    needs: ClassVar[frozenset[Need]] = frozenset({Need.MOMENTS})
    trending: ClassVar[bool] = True
    only_once: ClassVar[bool] = True
    shown_by: ClassVar[str] = (
        "measure {component} again after a period as long as this campaign, at temperatures that "
        "occurred in it"
    )
    against: ClassVar[Mapping[str, str]] = {
        "step": "measure {component} again after a period as long as this campaign: a drift will "
        "have gone on, a step will not",
        "thermal-lag": "measure {component} after a night of rest, at the same temperatures on two "
        "different days",
    }

    def propose(self, view: CampaignView) -> Proposals:
        """Every component, drifting since its maps or since the first visit."""
        return by_comparable_shapes(self, view, partial(_hypotheses, view))

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


def _hypotheses(view: CampaignView, code: str, shapes: list[Shape]) -> list[Hypothesis]:
    size = "drift_{unit}_per_day"
    return [
        additive(Drift.kind, code, SinceReference(since_s), shapes, size, variant=variant)
        for variant, since_s in beginnings_s(view, code).items()
    ]
