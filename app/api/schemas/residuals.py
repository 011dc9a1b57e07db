"""Residuals over HTTP: measured minus predicted, before anything is fitted."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Final, Self

from pydantic import ConfigDict, Field

from app.answer import IN_ITS_UNIT
from app.api.schemas.analyses import ChosenVerifications
from app.identification.analysis.residual_report import Size
from app.identification.residuals.residuals import LeftOut
from app.identification.residuals.summary import Summary
from app.rounding import Micro
from app.stated import Integer, Number, Schema, UtcTime

if TYPE_CHECKING:
    from app.services.residuals import ShownResiduals

MOST_ROWS: Final = 10_000


class ResidualsRequest(Schema):
    """Which verifications are compared with which version."""

    model_config = ConfigDict(json_schema_extra={"example": {"verifications": [1, 2], "rows": 100}})

    verifications: ChosenVerifications = None
    model_version: Integer | None = Field(None, description="Version; the active one if not stated")
    rows: Annotated[Integer, Field(ge=0, le=MOST_ROWS)] = Field(
        0, description="How many single residuals are shown too; `Accept: text/csv` gives all"
    )


class ResidualRow(Schema):
    """One measured number, compared with the model."""

    verification: int = Field(description="Number of the verification")
    observation: int = Field(description="Place of the observation in it, from 0")
    time: UtcTime = Field(description="When, UTC")
    component: str = Field(description="Component code, or `points x`")
    unit: str = Field(description="Unit of its numbers")
    x_mm: Number | None = Field(description="Where, as far as it is known [mm]")
    y_mm: Number | None = Field(description="The same [mm]")
    z_mm: Number | None = Field(description="The same [mm]")
    direction: str = Field(
        description="Approach: `+`, `-`, or `0` where not stated; at points of x, y and z",
        examples=["+", "+0-"],
    )
    measured: Number = Field(description=f"Measured {IN_ITS_UNIT}")
    predicted: Micro = Field(description=f"Predicted, adopted effects included {IN_ITS_UNIT}")
    residual: Micro = Field(
        description="Measured minus predicted. Where the instrument was zeroed, less the residual "
        "of its set-up's first observation; where the zero is not known, less the mean "
        f"{IN_ITS_UNIT}"
    )


class ResidualsAnswer(Schema):
    """What a model version leaves of verifications."""

    model_version: int = Field(description="Version that they were compared with")
    verifications: list[int] = Field(description="Numbers of the verifications")
    overall: Size | None = Field(description="All lengths; null where nothing is one")
    components: list[Size] = Field(description="Each component in its own unit")
    contradiction: str | None = Field(
        description="What is said of a stated repeatability that nearly all lengths contradict, as "
        "in an analysis: the figures rest on what they show; null where nothing is contradicted"
    )
    summaries: list[Summary] = Field(
        description="Components, and lengths along everything that they may depend on"
    )
    excluded: list[LeftOut] = Field(description="What cannot be compared with the model")
    counted_as_zero: list[str] = Field(
        description="Components that residuals at points need, that no two maps have and that "
        "count as zero: these residuals contain them whole",
        examples=[["ECZ"]],
    )
    rows: list[ResidualRow] = Field(description="Single residuals, as many as were asked for")

    @classmethod
    def of(cls, residuals: ShownResiduals, rows: list[dict[str, Any]]) -> Self:
        """Show residuals with some single ones."""
        return cls(
            model_version=residuals.model_version,
            verifications=list(residuals.verification_ids),
            overall=residuals.report.overall,
            components=list(residuals.report.components),
            contradiction=residuals.report.contradiction,
            summaries=list(residuals.report.summaries),
            excluded=list(residuals.report.excluded),
            counted_as_zero=list(residuals.report.residuals.counted_as_zero),
            rows=[ResidualRow(**row) for row in rows],
        )


class ComparisonRequest(Schema):
    """Versions to be compared with the same verifications."""

    model_config = ConfigDict(
        json_schema_extra={"example": {"verifications": [1, 2], "versions": [3, 4]}}
    )

    verifications: ChosenVerifications = None
    versions: Annotated[list[Integer], Field(min_length=1, max_length=20)] = Field(
        description="Numbers of the versions"
    )
