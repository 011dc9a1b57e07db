"""A change at one time: a collision, a re-levelling."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Final

import numpy as np

from app.effects.campaign_view import OWN_ZEROS, CampaignView
from app.effects.driver import StepAfter
from app.effects.effect import Effect
from app.effects.hypothesis import Nonlinear
from app.effects.kind import (
    EffectKind,
    Need,
    OverTime,
    Proposed,
    additive,
)
from app.effects.words import (
    components,
    size_along,
    symbol_of,
)
from app.thermal.error_map import ErrorMap
from app.units import date_text

MOST_TIMES: Final = 40
"""Of more visits, only so many beginnings are scanned, and the best is refined."""

FEWEST_BEFORE: Final = 3
"""So many visits before it tell what begins from what has been there all the time."""

NONE_BEFORE: Final = (
    "all of its observations are in the last visit, or the last block of a long one, so nothing "
    "shows how it was before a change"
)


class Step(EffectKind):
    """A component is another one from the beginning of some visit on."""

    kind = "step"
    text = "a change at one time: collision, re-levelling"
    over_time = OverTime.BEGINS
    of_time_alone = True
    drawn_over = "time"
    needs = Need.MOMENTS
    trending = True
    shown_by = (
        "ask what happened to the machine at that time, and measure {component} once more at "
        "temperatures that occurred before it"
    )
    against = {
        "drift": "measure {component} again after a period as long as this campaign: a drift will "
        "have gone on, a step will not",
        "sensor-fault": "compare {rival} with a calibrated thermometer placed beside it",
    }

    def propose(self, view: CampaignView) -> Proposed:
        """Every component, with a step at the beginning of any visit that is not its first."""
        for code in view.components:
            shapes = view.comparable_shapes(code, view.shapes(code))
            times = times_after_first(view, [code]) if shapes else None
            if times is None:
                yield self.refuse(code, NONE_BEFORE if shapes else OWN_ZEROS)
            else:
                yield additive(self.kind, code, _changed, shapes, "step_{unit}", nonlinear=times)

    def explain(self, effect: Effect) -> str:
        """Say what changed when, and by how much."""
        how = size_along(effect, "step", symbol_of(effect.components[0]))
        when = date_text(effect.parameters["changed_at_unix_s"])
        return f"{components(effect)} changed once, by {how}, at about {when}"

    def is_measured_along(self, new_map: ErrorMap, effect: Effect) -> bool:
        """Whether the map was measured after it."""
        return is_after_change(new_map, effect)


def is_after_change(error_map: ErrorMap, effect: Effect) -> bool:
    """Whether a map was measured after an effect that begins at one time began."""
    return error_map.measured_at.timestamp() >= effect.parameters["changed_at_unix_s"]


def change_times(view: CampaignView) -> Nonlinear:
    """List the times at which something may have changed: of visits and of long ones' blocks."""
    starts = view.moments_s[1:]
    chosen = starts
    if starts.size > MOST_TIMES:
        chosen = starts[np.linspace(0, starts.size - 1, MOST_TIMES).round().astype(int)]
    grid = tuple(np.unique(chosen).tolist())
    bounds = (grid[0], grid[-1]) if starts.size > MOST_TIMES else None
    return Nonlinear("changed_at_unix_s", 1.0, grid, bounds, log_scale=False)


def times_after_first(view: CampaignView, codes: Iterable[str]) -> Nonlinear | None:
    """List those before which some component was observed; None: there are none.

    A beginning before all observations of what changed is a constant in every one of them: nobody
    saw it come, and a map that no longer holds would look the same.
    """
    rows = np.concatenate([view.projection.view(code).rows for code in codes])
    first_s = view.rows.times_s[rows].min()
    times = change_times(view)
    grid = tuple(time for time in times.grid if time > first_s)
    if not grid:
        return None
    return replace(times, grid=grid, bounds=times.bounds and (grid[0], grid[-1]))


def times_within(view: CampaignView) -> Nonlinear | None:
    """List those before which enough visits tell that it had not begun; None: there are none.

    Of what may have been there all the time, a beginning at the second visit is no other answer.
    """
    times = change_times(view)
    grid = times.grid[FEWEST_BEFORE - 1 :]
    if not grid:
        return None
    return replace(times, grid=grid, bounds=times.bounds and (grid[0], grid[-1]))


def _changed(theta: float | None) -> StepAfter:
    return StepAfter(float(theta or 0.0))
