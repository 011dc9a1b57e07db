"""Components that no map has: constant in time, or growing with a temperature."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from typing import ClassVar, Final

from app.effects.campaign_view import CampaignView
from app.effects.driver import AboveReference, Always
from app.effects.hypothesis import Hypothesis
from app.effects.kind import EffectKind, Need, Proposed, additive
from app.geometry.components import COMPONENTS, Kind

CONSTANT: Final = "constant"
WITH_TEMPERATURE: Final = "with temperature"


class LackedByMaps(EffectKind):
    """Components of one kind that the model lacks, and that show at some point.

    `of` is that kind and `name` its word; an amplitude of a constant one is called `size`.
    """

    lacked_by_maps = True
    needs = Need.POINTS
    of_the_type = True
    of: ClassVar[Kind]
    name: ClassVar[str]
    size: ClassVar[str]

    @abstractmethod
    def may_grow_with(self, view: CampaignView, code: str) -> Iterable[str]:
        """Name the sensors with which a component may grow."""

    def propose(self, view: CampaignView) -> Proposed:
        """Each of them, constant and with a temperature."""
        lacking = [
            c.code
            for c in COMPONENTS.values()
            if c.kind is self.of and c.code not in view.in_model and view.shows(c.code)
        ]
        if not lacking:
            why = f"the maps already have every {self.name} that these observations can show"
            yield self.refuse("", why)
        for code in lacking:
            for sensor in ("", *self.may_grow_with(view, code)):
                yield self._hypothesis(view, code, sensor)

    def _hypothesis(self, view: CampaignView, code: str, sensor: str) -> Hypothesis:
        if sensor:
            return additive(
                *(self.kind, code, AboveReference(sensor, view.reference_c(sensor))),
                *(view.shapes(code), "slope_{unit}_per_k"),
                variant=WITH_TEMPERATURE,
                sensors=(sensor,),
            )
        # A single visit shows what is constant in time.
        return additive(
            *(self.kind, code, Always(), view.shapes(code), f"{self.size}_{{unit}}"),
            variant=CONSTANT,
            standing=True,
            within_visit=True,
        )
