"""A fleet over HTTP: what is asked of all machines, how far that is, what it says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Self

from pydantic import ConfigDict, Field

from app.api.schemas.analyses import AnalysisHead
from app.api.schemas.base import Number, Schema
from app.identification.fleet import FleetJudgement
from app.services.fleet import HOLDOUT, FleetMember, FleetQuestion, FleetView


class FleetRequest(Schema):
    """What the analysis of every machine is asked."""

    model_config = ConfigDict(json_schema_extra={"example": {"effects": ["thermal-lag"]}})

    effects: Annotated[list[str], Field(min_length=1, max_length=100)] | None = Field(
        None,
        description="Kinds of effects to look for; all of them where it is left out",
        examples=[["thermal-lag", "backlash"]],
    )
    holdout_fraction: Annotated[Number, Field(gt=0.0, lt=0.9)] = Field(
        HOLDOUT, description="Share of the visits that take no part in the search, below 0.9"
    )

    def to_question(self) -> FleetQuestion:
        """Make the question."""
        return FleetQuestion(self.effects, self.holdout_fraction)


class FleetMemberAnswer(Schema):
    """How far one machine's analysis is."""

    machine: str = Field(description="Its id")
    name: str = Field(description="Its name for people")
    analysis: AnalysisHead | None = Field(
        description="The analysis that asked this of the active model and all stored "
        "verifications; null where there is none"
    )
    to_be_asked: bool = Field(
        description="Whether none was asked for, or the last one failed or was cancelled"
    )
    why_not: str | None = Field(description="Why none can be asked for; null where one can")

    @classmethod
    def of(cls, member: FleetMember) -> Self:
        """Show a machine."""
        return cls(
            machine=member.id,
            name=member.name,
            analysis=None if member.job is None else AnalysisHead.of(member.job),
            to_be_asked=member.is_to_be_asked,
            why_not=member.why_not or None,
        )


class FleetAnswer(Schema):
    """How far the analyses of all machines are, and what they say together."""

    machines: list[FleetMemberAnswer] = Field(description="Every machine")
    going_on: bool = Field(
        description="Whether more will be said without anybody asking for more: an analysis waits "
        "or runs, or effects are still to be tried on sisters"
    )
    tried: int = Field(description="Effects that were tried on sisters so far")
    wanted: int = Field(description="How many are to be tried; 0 until every analysis has ended")
    judgement: FleetJudgement | None = Field(
        description="What the analyses say together; null as long as something goes on"
    )
    done: list[str] = Field(
        description="Machines whose analysis was asked for, or cancelled, by this request"
    )
    refused: Mapping[str, str] = Field(description="By machine, why that was not done")
    queue_full: bool = Field(
        description="Whether some were refused because too many analyses wait: ask again later"
    )

    @classmethod
    def of(cls, view: FleetView) -> Self:
        """Show a fleet."""
        return cls(
            machines=[FleetMemberAnswer.of(member) for member in view.members],
            going_on=view.is_going_on,
            tried=view.tried,
            wanted=view.wanted,
            judgement=view.judgement,
            done=list(view.done),
            refused=view.refused,
            queue_full=view.queue_full,
        )
