"""What planning answers: what a plan of measurements could see, and which visit to add."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from app.answer import IN_ITS_UNIT, Answer, UnitSymbol
from app.effects.claim import AnsweredClaim
from app.effects.kind import NotTested
from app.identification.plan.visit import NextVisit
from app.identification.residuals.residuals import LeftOut


@dataclass(frozen=True, slots=True)
class PlannedRival(AnsweredClaim, published_as="PlannedRivalAnswer"):
    """The effect that imitates another one best."""

    overlap: float
    """Share of the effect that it can reproduce"""

    separating_measurement: str | None
    """What would tell them apart"""


@dataclass(frozen=True, slots=True)
class PlannedEffect(AnsweredClaim, published_as="PlannedEffectAnswer"):
    """The smallest effect of one kind that the plan would find nine times in ten.

    A time constant, pitch or time of change is taken from the middle of those that are searched.
    """

    unit: UnitSymbol
    """Unit of its numbers"""

    smallest_rms: Annotated[
        float,
        Field(description=f"Its root mean square over the values on which it acts {IN_ITS_UNIT}"),
    ]
    distinguishable_rms: Annotated[
        float | None,
        Field(
            description="The size from which it can be told from its closest rival; null where "
            f"nothing in this plan tells them apart {IN_ITS_UNIT}"
        ),
    ]
    rival: PlannedRival | None
    """Its closest rival of another kind"""


@dataclass(frozen=True, slots=True)
class ImprovedEffect(AnsweredClaim, published_as="HelpedAnswer"):
    """What an added visit does for one effect."""

    unit: UnitSymbol
    """Unit of its numbers"""

    before_rms: Annotated[
        float,
        Field(description=f"Smallest size that is seen without the added visit {IN_ITS_UNIT}"),
    ]
    after_rms: Annotated[
        float, Field(description=f"Smallest size that is seen with it {IN_ITS_UNIT}")
    ]


@dataclass(frozen=True, slots=True)
class Suggestion(Answer, published_as="SuggestionAnswer"):
    """A visit to add."""

    visit: NextVisit
    """What to do, and what it improves"""

    helped: tuple[ImprovedEffect, ...]
    """The effects whose smallest visible size falls most"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan(Answer, published_as="PlanAnswer"):
    """What a plan of measurements could see and tell apart, and which visit to add."""

    model_version: int
    """Version that would be analysed"""

    summary: str
    """The answer in plain sentences"""

    visits: int
    """Planned visits"""

    values: int
    """Planned values"""

    notes: tuple[str, ...]
    """Assumptions that were made"""

    effects: tuple[PlannedEffect, ...]
    """The hardest to tell apart first"""

    not_testable: tuple[NotTested, ...]
    """Effects that the plan could not show, with the reasons"""

    excluded: tuple[LeftOut, ...]
    """Values that cannot be compared with the model"""

    suggestions: tuple[Suggestion, ...]
    """Visits to add, most useful first"""
