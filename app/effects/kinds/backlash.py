"""Reversal: an axis that comes from above stops elsewhere than one that comes from below."""

from __future__ import annotations

from app.effects.campaign_view import CampaignView
from app.effects.driver import Always
from app.effects.effect import Effect
from app.effects.hypothesis import Amplitude, Hypothesis
from app.effects.kind import EffectKind, Need, Proposed
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

    kind = "backlash"
    text = "reversal error: half the reversal value with the sign of the approach"
    alternates = True
    drawn_over = "position"
    needs = Need.DIRECTION
    only_once = True
    of_the_type = True
    shown_by = (
        "approach the same positions of {component} alternately from both sides, five times each"
    )
    against = {
        "periodic": "approach each position of {component} from both sides: reversal shows as the "
        "difference between the two, whatever the position",
    }

    def propose(self, view: CampaignView) -> Proposed:
        """Every component whose own axis came from both sides."""
        for code in view.tables:
            directions = view.projection.view(code).places.directions
            if not ((directions > 0).any() and (directions < 0).any()):
                axis = str(COMPONENTS[code].axis).upper()
                yield self.refuse(code, f"{axis} was always approached from the same side")
                continue
            yield _hypothesis(code, None)
            if (rising := view.rising(code)) is not None:
                yield _hypothesis(code, rising)

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
