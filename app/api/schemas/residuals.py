"""Residuals over HTTP: measured minus predicted, before anything is fitted."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Final, Self

from pydantic import ConfigDict, Field

from app.api.schemas.analyses import VerificationIds
from app.api.schemas.analysis_result import IN_ITS_UNIT, ExcludedAnswer
from app.api.schemas.base import Integer, Number, Schema, UtcTime

if TYPE_CHECKING:
    from app.identification.residual_report import ResidualReport, Size
    from app.identification.residual_summary import Bin
    from app.services.compare_models import ComparedVersion
    from app.services.show_residuals import ShownResiduals

MOST_ROWS: Final = 10_000


class ResidualsRequest(Schema):
    """Which verifications are held against which version."""

    model_config = ConfigDict(json_schema_extra={"example": {"verifications": [1, 2], "rows": 100}})

    verifications: VerificationIds = Field(description="Numbers of the verifications")
    model_version: Integer | None = Field(None, description="Version; the active one if not stated")
    rows: Annotated[Integer, Field(ge=0, le=MOST_ROWS)] = Field(
        0, description="How many single residuals are shown too; `Accept: text/csv` gives all"
    )


class SizeAnswer(Schema):
    """Size of the residuals of one component, or of all lengths together."""

    component: str = Field(description="Component code, `points x`, or `all`", examples=["EZZ"])
    unit: str = Field(description="Unit of its numbers", examples=["µm"])
    count: int = Field(description="How many values")
    mean: Number = Field(description=f"Mean {IN_ITS_UNIT}")
    rms: Number = Field(description=f"Root mean square {IN_ITS_UNIT}")
    p95: Number = Field(description=f"95th percentile of the size {IN_ITS_UNIT}")
    repeatability: Number | None = Field(
        description=f"Standard deviation of one observation {IN_ITS_UNIT}"
    )
    repeatability_origin: str = Field(
        description="`declared`, from `replicates`, or guessed from the `residuals` within visits"
    )
    share_above_repeatability: Number | None = Field(
        description="Share that exceeds it in size; noise alone: 0.32"
    )

    @classmethod
    def of(cls, size: Size) -> Self:
        """Show sizes."""
        return cls(
            component=size.component,
            unit=size.unit,
            count=size.count,
            mean=size.mean,
            rms=size.rms,
            p95=size.p95,
            repeatability=size.noise,
            repeatability_origin=size.noise_origin,
            share_above_repeatability=size.share_above,
        )


class BinAnswer(Schema):
    """Residuals that have something in common."""

    label: str = Field(description="What they have in common", examples=["24.1 to 25.3"])
    low: Number | None = Field(description="Its lower end; null for a name [mm; °C, s …]")
    high: Number | None = Field(description="Its upper end; null for a name [mm; °C, s …]")
    count: int = Field(description="How many values")
    mean: Number = Field(description=f"Mean {IN_ITS_UNIT}")
    rms: Number = Field(description=f"Root mean square {IN_ITS_UNIT}")
    p95: Number = Field(description=f"95th percentile of the size {IN_ITS_UNIT}")
    share_above_repeatability: Number | None = Field(
        description="Share that exceeds the repeatability in size"
    )

    @classmethod
    def of(cls, one: Bin) -> Self:
        """Show a bin."""
        fields = {name: getattr(one, name) for name in ("label", "low", "high", "count", "mean")}
        return cls(**fields, rms=one.rms, p95=one.p95, share_above_repeatability=one.share_above)


class SummaryAnswer(Schema):
    """Residuals along one quantity."""

    over: str = Field(
        description="Component, position, time, temperature, rate, state or direction",
        examples=["temperature z-column [°C]"],
    )
    bins: list[BinAnswer] = Field(description="In the order of the quantity")


class ResidualRow(Schema):
    """One number that was measured, held against the model."""

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
    predicted: Number = Field(description=f"Predicted, adopted effects included {IN_ITS_UNIT}")
    residual: Number = Field(
        description="Measured minus predicted, without the unknown zero of a datum that is not "
        f"absolute {IN_ITS_UNIT}"
    )


class ResidualsAnswer(Schema):
    """What a model version leaves of verifications."""

    model_version: int = Field(description="Version that was held against them")
    verifications: list[int] = Field(description="Numbers of the verifications")
    overall: SizeAnswer | None = Field(description="All lengths; null where nothing is one")
    components: list[SizeAnswer] = Field(description="Each component in its own unit")
    summaries: list[SummaryAnswer] = Field(
        description="Components, and lengths along everything that they may depend on"
    )
    excluded: list[ExcludedAnswer] = Field(description="What cannot be held against the model")
    counted_as_zero: list[str] = Field(
        description="Components that residuals at points need, that no two maps have and that "
        "count as zero: these residuals contain them whole",
        examples=[["ECZ"]],
    )
    rows: list[ResidualRow] = Field(description="Single residuals, as many as were asked for")

    @classmethod
    def of(cls, shown: ShownResiduals, rows: list[dict[str, Any]]) -> Self:
        """Show residuals with some single ones."""
        return cls(
            model_version=shown.model_version,
            verifications=list(shown.verification_ids),
            **_sizes(shown.report),
            summaries=[
                SummaryAnswer(over=s.over, bins=[BinAnswer.of(b) for b in s.bins])
                for s in shown.report.summaries
            ],
            excluded=[
                ExcludedAnswer(reason=e.reason, count=e.count) for e in shown.report.excluded
            ],
            counted_as_zero=list(shown.report.residuals.counted_as_zero),
            rows=[ResidualRow(**row) for row in rows],
        )


class ComparisonRequest(Schema):
    """Versions to be held against the same verifications."""

    model_config = ConfigDict(
        json_schema_extra={"example": {"verifications": [1, 2], "versions": [3, 4]}}
    )

    verifications: VerificationIds = Field(description="Numbers of the verifications")
    versions: Annotated[list[Integer], Field(min_length=1, max_length=20)] = Field(
        description="Numbers of the versions"
    )


class ComparedVersionAnswer(Schema):
    """One version, on what all of them can be held against."""

    version: int = Field(description="Number of the version")
    reason: str = Field(description="What made it")
    active: bool = Field(description="Whether tables are computed with it now")
    overall: SizeAnswer | None = Field(description="All lengths; null where nothing is one")
    components: list[SizeAnswer] = Field(description="Each component in its own unit")


class ModelComparisonAnswer(Schema):
    """Versions side by side, in the order in which they were named."""

    verifications: list[int] = Field(description="Numbers of the verifications")
    values: int = Field(description="Values that all versions can be held against")
    versions: list[ComparedVersionAnswer] = Field(description="The versions")

    @classmethod
    def of(cls, verifications: list[int], compared: list[ComparedVersion]) -> Self:
        """Show a comparison."""
        return cls(
            verifications=verifications,
            values=sum(size.count for size in compared[0].report.components),
            versions=[
                ComparedVersionAnswer(
                    version=one.version,
                    reason=one.reason,
                    active=one.active,
                    **_sizes(one.report),
                )
                for one in compared
            ],
        )


def _sizes(report: ResidualReport) -> dict[str, Any]:
    overall = report.overall
    return {
        "overall": None if overall is None else SizeAnswer.of(overall),
        "components": [SizeAnswer.of(size) for size in report.components],
    }
