"""The tables no longer hold: a shift, a slope, both, or a profile, constant in time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, Final

import numpy as np

from app.effects.campaign_view import CampaignView
from app.effects.driver import Always
from app.effects.effect import Effect
from app.effects.hypothesis import Amplitude, Hypothesis
from app.effects.kind import DrawnOver, EffectKind, Proposals
from app.effects.shape import Everywhere, Profile, Shape
from app.effects.term import Term
from app.effects.words import parameter, size_along, symbol_of
from app.geometry.components import COMPONENTS

SHIFT, SLOPE, LINE, PROFILE = "shift", "slope", "straight line", "profile"
MOST_CORNERS: Final = 9


class OutdatedMap(EffectKind):
    """The same deviation from all maps, whatever the temperatures and the time."""

    kind: ClassVar[str] = "outdated-map"
    text: ClassVar[str] = "the tables no longer hold: a shift, a slope, both, or a profile"
    drawn_over: ClassVar[DrawnOver] = "position"
    remedy: ClassVar[str] = (
        "Measure a new map of {components}; until then the correction may be adopted."
    )
    shown_by: ClassVar[str] = "measure a new map of {component}"
    against: ClassVar[Mapping[str, str]] = {
        "temperature-curvature": "measure {component} at the temperature of one of the maps: an "
        "outdated map is wrong there too",
        "step": "find out whether {component} was still right early in the campaign",
    }

    def propose(self, view: CampaignView) -> Proposals:
        """Every component in four forms; a single value can only shift.

        What drives a component along a straight line, and hardly changes in the campaign, is this
        as well: without a form for both, it would be called after what drives it.
        """
        found = Proposals()
        for code in view.components:
            found.hypotheses.append(_hypothesis(code, SHIFT, [Everywhere()], ["shift"]))
            rising = view.shapes(code)[1:]
            if rising:
                found.hypotheses.append(_hypothesis(code, SLOPE, rising, ["slope_at_end"]))
            if rising and not view.rows.has_own_zero[view.projection.view(code).rows].all():
                line = _hypothesis(code, LINE, [Everywhere(), *rising], ["shift", "shift_rise"])
                found.hypotheses.append(replace(line, is_within_visit=False))
            corners = _corners(view, code)
            if rising and len(corners) > 2:
                names = [f"profile_at_{x:g}_mm" for x in corners]
                found.hypotheses.append(_hypothesis(code, PROFILE, _hats(corners), names))
        return found

    def explain(self, effect: Effect) -> str:
        """Say how far the tables are off."""
        code = effect.components[0]
        if effect.variant == PROFILE:
            off = max(effect.parameters.values(), key=abs)
            return f"the maps of {code} no longer hold: they are off by up to {off:.2g} " + (
                symbol_of(code)
            )
        if effect.variant == LINE:
            how = size_along(effect, "shift", symbol_of(code))
            return f"the maps of {code} no longer hold: they are shifted by {how}"
        (name,) = effect.parameters
        how = parameter(effect, name, symbol_of(code))
        by = (
            f"shifted by {how}"
            if effect.variant == SHIFT
            else f"off by {how} at the upper end of travel, and by the opposite at the lower end"
        )
        return f"the maps of {code} no longer hold: they are {by}"


def _hypothesis(
    code: str, variant: str, shapes: Sequence[Shape], names: Sequence[str]
) -> Hypothesis:
    return Hypothesis(
        kind=OutdatedMap.kind,
        variant=variant,
        components=(code,),
        unit_terms=lambda _: [[Term(code, Always(), shape)] for shape in shapes],
        amplitudes=tuple(Amplitude(f"{name}_{COMPONENTS[code].unit}") for name in names),
        is_standing=True,
        is_within_visit=variant != SHIFT,
    )


def _corners(view: CampaignView, code: str) -> tuple[float, ...]:
    """Choose at most nine of the table's positions."""
    positions = view.positions_mm(code)
    if positions.size > MOST_CORNERS:
        chosen = np.linspace(0, positions.size - 1, MOST_CORNERS).round().astype(int)
        positions = positions[chosen]
    return tuple(positions.tolist())


def _hats(corners: tuple[float, ...]) -> list[Shape]:
    heights = np.eye(len(corners))
    return [Profile(corners, tuple(row.tolist())) for row in heights]
