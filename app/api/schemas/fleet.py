"""What is asked of all machines of a fleet over HTTP."""

from __future__ import annotations

from typing import Annotated

from pydantic import ConfigDict, Field

from app.api.schemas.base import Number, Schema
from app.services.fleet import HOLDOUT, FleetQuestion


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
