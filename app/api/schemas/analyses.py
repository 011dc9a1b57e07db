"""What is asked of analyses over HTTP."""

from __future__ import annotations

from typing import Annotated

from pydantic import ConfigDict, Field

from app.api.schemas.verifications import PlannedObservation
from app.effects.observations import Verification
from app.errors import InvalidContent
from app.in_pieces import InPieces
from app.search.rows import Datum
from app.stated import Integer, Name, Number, Schema, YesOrNo
from app.storage.records import LARGEST_INTEGER

VerificationIds = Annotated[list[Integer], Field(min_length=1, max_length=10_000)]
"""Numbers of verifications."""

ChosenVerifications = Annotated[
    VerificationIds | None,
    Field(description="Numbers of the verifications; all that are stored where it is left out"),
]


class AnalysisRequest(Schema):
    """What the active model is compared with, and which effects are looked for."""

    model_config = ConfigDict(
        json_schema_extra={"example": {"verifications": [1, 2, 3], "holdout_fraction": 0.3}}
    )

    verifications: ChosenVerifications = None
    holdout_fraction: Annotated[Number, Field(gt=0.0, lt=0.9)] = Field(
        0.3, description="Share of the visits that take no part in the search, below 0.9"
    )
    effects: Annotated[list[str], Field(min_length=1, max_length=100)] | None = Field(
        None,
        description="Kinds of effects to look for; all of them where it is left out",
        examples=[["thermal-lag", "backlash"]],
    )
    seed: Annotated[Integer, Field(ge=0, le=LARGEST_INTEGER)] = Field(
        0, description="Seed of all random draws: the same data and seed give the same answer"
    )


class PlannedVerification(Schema):
    """Observations that are to be taken with one set-up."""

    label: Name = Field("planned", description="Its name in the answer", examples=["Monday"])
    datum: Datum = Field(Datum.ABSOLUTE, description="`absolute`, `first` or `free`")
    repeatability_um: Annotated[Number, Field(gt=0)] | None = Field(
        None,
        description="Standard deviation of one length [µm], where it is known; it does not "
        "apply to angles and squareness",
    )
    observations: Annotated[list[PlannedObservation], InPieces(20_000)] = Field(
        description="What is to be measured"
    )

    def to_verification(self) -> Verification:
        """Make the verification; InvalidContent names the observation that is wrong."""
        observations = []
        for i, observation in enumerate(self.observations):
            try:
                observations.append(observation.to_planned())
            except InvalidContent as error:
                raise error.inside(f"observations.{i}") from None
        return Verification(
            self.label, observations, self.datum, self.repeatability_um, is_planned=True
        )


class VisitPreview(Schema):
    """A visit that is yet to be made, read from a file."""

    planned: PlannedVerification = Field(description="As it may be planned with")
    warnings: list[str] = Field(description="What of the file was not read, or may be a mistake")


class PlanRequest(Schema):
    """What is to be measured, and which stored verifications would be analysed beside it."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "planned": [
                    {
                        "observations": [
                            {"time": "2026-03-09T06:00:00Z", "component": "EXX", "position_mm": 250}
                        ]
                    }
                ]
            }
        }
    )

    planned: Annotated[list[PlannedVerification], Field(max_length=1000)] = Field(
        default_factory=list, description="What is to be measured, visit by visit"
    )
    verifications: Annotated[list[Integer], Field(max_length=10_000)] = Field(
        default_factory=list, description="Numbers of stored verifications"
    )

    def to_verifications(self) -> list[Verification]:
        """Make the planned verifications; InvalidContent names what is wrong."""
        verifications = []
        for i, body in enumerate(self.planned):
            try:
                verifications.append(body.to_verification())
            except InvalidContent as error:
                raise error.inside(f"planned.{i}") from None
        return verifications


class TriedEffectRequest(Schema):
    """An effect that an analysis found, and the machine on which it is tried."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "machine": "vmc-1",
                "analysis": 3,
                "effect": 0,
                "on": "vmc-2",
                "verifications": [1, 2, 3],
                "tried_together": 4,
            }
        }
    )

    machine: Name = Field(description="The machine on which it was found")
    analysis: Integer = Field(description="Number of the analysis that found it")
    effect: Annotated[Integer, Field(ge=0, le=LARGEST_INTEGER)] = Field(
        description="Which of its effects, from 0"
    )
    on: Name = Field(description="The machine on which it is tried, with its active model")
    verifications: VerificationIds = Field(description="Numbers of that machine's verifications")
    tried_together: Annotated[Integer, Field(ge=1, le=LARGEST_INTEGER)] = Field(
        1,
        description="Number of machines on which effects are tried in all: thresholds rise with it",
    )


class AdoptionRequest(Schema):
    """Which of the effects that an analysis found go into the model."""

    effects: Annotated[list[Integer], Field(min_length=1, max_length=100)] | None = Field(
        None,
        description="Places in the result's list of effects, from 0, whatever is known of them; "
        "where it is left out, those that help (`helps`)",
        examples=[[0, 1]],
    )
    onto_active: YesOrNo = Field(
        False,
        description="Whether to add them to the active version where that is no longer the one "
        "that was analysed: they were found on another model, so look at its residuals after",
    )
