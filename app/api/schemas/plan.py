"""What a plan of measurements could see, over HTTP."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Self

from pydantic import Field

from app.api.schemas.analysis_result import IN_ITS_UNIT, ExcludedAnswer, NotTestedAnswer
from app.api.schemas.base import Number, Schema, UtcTime

if TYPE_CHECKING:
    from app.identification.plan import Plan


class PlannedRivalAnswer(Schema):
    """What imitates an effect best."""

    kind: str = Field(description="Kind of effect")
    components: list[str] = Field(description="On which components")
    sensors: list[str] = Field(description="Driven by which sensors")
    states: list[str] = Field(description="Driven by which states")
    overlap: Number = Field(description="Share of the effect that it reproduces")
    separating_measurement: str | None = Field(description="What would tell them apart")


class PlannedEffectAnswer(Schema):
    """The smallest effect of one kind that the plan would find nine times in ten."""

    kind: str = Field(description="Kind of effect", examples=["thermal-lag"])
    variant: str = Field(description="Which form of the kind; empty where it has one only")
    components: list[str] = Field(description="On which components")
    sensors: list[str] = Field(description="Driven by which sensors")
    states: list[str] = Field(description="Driven by which states")
    unit: str = Field(description="Unit of its numbers", examples=["µm"])
    smallest_rms: Number = Field(
        description=f"Its root mean square over the rows in which it shows {IN_ITS_UNIT}"
    )
    distinguishable_rms: Number | None = Field(
        description="The same to be told from its closest rival; null where nothing in this plan "
        f"tells them apart {IN_ITS_UNIT}"
    )
    rival: PlannedRivalAnswer | None = Field(description="Its closest rival of another kind")


class HelpedAnswer(Schema):
    """What an added visit does for one effect."""

    kind: str = Field(description="Kind of effect")
    components: list[str] = Field(description="On which components")
    sensors: list[str] = Field(description="Driven by which sensors")
    states: list[str] = Field(description="Driven by which states")
    unit: str = Field(description="Unit of its numbers", examples=["µm"])
    before_rms: Number = Field(description=f"Smallest that is seen without it {IN_ITS_UNIT}")
    after_rms: Number = Field(description=f"Smallest that is seen with it {IN_ITS_UNIT}")


class SuggestionAnswer(Schema):
    """A visit to add."""

    sentence: str = Field(description="Which, and what it helps")
    like_time: UtcTime = Field(description="When the machine was like that, UTC")
    temperatures_c: dict[str, Number] = Field(description="Its sensors' temperatures then [°C]")
    states: dict[str, Number] = Field(description="Its state then")
    helped: list[HelpedAnswer] = Field(description="The effects that gain most")


class PlanAnswer(Schema):
    """What a plan of measurements could see and tell apart, and which visit to add."""

    model_version: int = Field(description="Version that would be analysed")
    summary: str = Field(description="Two plain sentences")
    visits: int = Field(description="Planned visits")
    values: int = Field(description="Planned values")
    notes: list[str] = Field(description="What was assumed")
    effects: list[PlannedEffectAnswer] = Field(description="The hardest to tell apart first")
    not_testable: list[NotTestedAnswer] = Field(description="What could not be seen")
    excluded: list[ExcludedAnswer] = Field(description="What cannot be held against the model")
    suggestions: list[SuggestionAnswer] = Field(description="Visits to add, most useful first")

    @classmethod
    def of(cls, model_version: int, plan: Plan) -> Self:
        """Show a plan."""
        fields: dict[str, Any] = plan.to_json()
        return cls(model_version=model_version, **fields)
