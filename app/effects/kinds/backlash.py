"""Reversal: an axis that comes from above stops elsewhere than one that comes from below."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from app.effects.campaign_view import CampaignView
from app.effects.driver import Always
from app.effects.effect import Effect
from app.effects.hypothesis import Amplitude, Hypothesis
from app.effects.kind import DrawnOver, EffectKind, Need, Proposals
from app.effects.shape import Everywhere, Rising
from app.effects.term import Term
from app.effects.words import size_along, symbol_of
from app.geometry.components import COMPONENTS
from app.thermal.error_map import ErrorMap

SAME_EVERYWHERE, ALONG_AXIS = "constant", "along the axis"


class Backlash(EffectKind):
    """Half the reversal value with the sign of the approach, constant or along the axis.

    The reversal value is that of ISO 230-2: coming from below minus coming from above.
    """

    kind: ClassVar[str] = "backlash"
    text: ClassVar[str] = "reversal error: half the reversal value with the sign of the approach"
    alternates: ClassVar[bool] = True
    drawn_over: ClassVar[DrawnOver] = "position"
    needs: ClassVar[frozenset[Need]] = frozenset({Need.DIRECTION})
    only_once: ClassVar[bool] = True
    of_the_type: ClassVar[bool] = True
    shown_by: ClassVar[str] = (
        "approach the same positions of {component} alternately from both sides, five times each"
    )
    against: ClassVar[Mapping[str, str]] = {
        "periodic": "approach each position of {component} from both sides: reversal shows as the "
        "difference between the two, whatever the position",
    }

    def propose(self, view: CampaignView) -> Proposals:
        """Every component whose own axis came from both sides."""
        proposals = Proposals()
        for code in view.tables:
            directions = view.projection.view(code).places.directions
            if not ((directions > 0).any() and (directions < 0).any()):
                axis = str(COMPONENTS[code].axis).upper()
                reason = f"{axis} was always approached from the same side"
                proposals.not_testable.append(self.refuse(code, reason))
                continue
            rising = view.rising(code)
            proposals.hypotheses.append(_hypothesis(code, None))
            if rising is not None:
                proposals.hypotheses.append(_hypothesis(code, rising))
        return proposals

    def explain(self, effect: Effect) -> str:
        """Say how large the reversal is."""
        how = size_along(effect, "reversal", symbol_of(effect.components[0]))
        return f"{effect.components[0]} has a reversal value of {how}"

    def is_measured_along(self, new_map: ErrorMap, effect: Effect) -> bool:
        """Whether the map was measured in both directions."""
        tables = (new_map.tables.get(code) for code in effect.components)
        return any(table is not None and table.backward_errors is not None for table in tables)


def _hypothesis(code: str, rising: Rising | None) -> Hypothesis:
    unit = COMPONENTS[code].unit
    shapes = [Everywhere()] if rising is None else [Everywhere(), rising]
    names = (f"reversal_{unit}", f"reversal_rise_{unit}")[: len(shapes)]
    return Hypothesis(
        kind=Backlash.kind,
        variant=SAME_EVERYWHERE if rising is None else ALONG_AXIS,
        components=(code,),
        unit_terms=lambda _: [[Term(code, Always(), s, is_reversing=True)] for s in shapes],
        # The amplitude is half of the reversal value.
        amplitudes=tuple(Amplitude(name, 2.0) for name in names),
        within_visit=True,
    )
