"""Whether a machine still is as its model says, over HTTP."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Literal, Self

from pydantic import Field

from app.api.schemas.analysis_result import IN_ITS_UNIT
from app.api.schemas.base import Number, Schema, UtcTime

if TYPE_CHECKING:
    from app.services.show_watch import Watch


class FollowedNumber(Schema):
    """One number that is followed from visit to visit."""

    component: str = Field(description="Component code, or `points x`", examples=["EZZ"])
    what: str = Field(description="`level`, or a slope along an axis", examples=["level"])
    unit: str = Field(description="Unit of its deviation", examples=["µm"])
    deviation: Number = Field(description=f"Latest measured minus predicted {IN_ITS_UNIT}")
    expected_sd: Number = Field(
        description=f"Standard deviation that was to be expected of it {IN_ITS_UNIT}"
    )
    evidence: Number = Field(description="Its e-value")


class JudgementAnswer(Schema):
    """What a verification says of the model that was active when it came."""

    model_version: int | None = Field(description="That version; null where there was none")
    status: Literal["within", "beyond", "not-judged"] = Field(
        description="`within` or `beyond` its limits by a sequential test, with all before it; "
        "`not-judged` with the reason in `summary`"
    )
    evidence: Number | None = Field(description="E-value of all verifications so far")
    limit: Number | None = Field(
        description="What the evidence ever reaches by chance with probability `false_alarm` only"
    )
    false_alarm: Number | None = Field(
        description="Probability that an unchanged machine is ever called changed"
    )
    summary: str = Field(description="One sentence")
    beyond: list[FollowedNumber] = Field(
        description="What has changed since the model was made, the clearest first"
    )
    visits: int = Field(description="Visits of the verification that were looked at")


class JudgedVerification(Schema):
    """One verification of the sequence."""

    verification: int = Field(description="Number of the verification")
    label: str = Field(description="Its name", examples=["night shift"])
    last_at: UtcTime = Field(description="Time of its last observation, UTC")
    status: str = Field(description="`within`, `beyond` or `not-judged`")
    evidence: Number | None = Field(description="E-value of all verifications up to it")


class WatchAnswer(Schema):
    """Where the sequential test of the active version stands."""

    model_version: int = Field(description="The active version")
    status: Literal["within", "beyond", "no-verification"] = Field(
        description="`no-verification` before the first one was judged"
    )
    beyond_since: UtcTime | None = Field(
        description="Time of the visit that first exceeded the limit, UTC; null: none did"
    )
    evidence: Number = Field(description="E-value of all verifications so far; 1 without any")
    limit: Number = Field(
        description="What the evidence ever reaches by chance with probability `false_alarm` only"
    )
    false_alarm: Number = Field(
        description="Probability that an unchanged machine is ever called changed"
    )
    updated_at: UtcTime | None = Field(description="When the last verification was judged, UTC")
    numbers: list[FollowedNumber] = Field(description="What is followed, strongest evidence first")
    verifications: list[JudgedVerification] = Field(description="What was judged, oldest first")

    @classmethod
    def of(cls, watch: Watch) -> Self:
        """Show a watch."""
        from app.identification.watching import FALSE_ALARM, LIMIT

        is_beyond = watch.beyond_since is not None
        none_yet = not watch.state.streams
        return cls(
            model_version=watch.model_version,
            status="no-verification" if none_yet else "beyond" if is_beyond else "within",
            beyond_since=watch.beyond_since,
            evidence=watch.state.evidence(),
            limit=LIMIT,
            false_alarm=FALSE_ALARM,
            updated_at=watch.updated_at,
            numbers=[FollowedNumber(**asdict(one)) for one in watch.state.all_followed()],
            verifications=[
                JudgedVerification(
                    verification=v.id,
                    label=v.label,
                    last_at=v.last_at,
                    status=(v.judgement or {})["status"],
                    evidence=(v.judgement or {})["evidence"],
                )
                for v in watch.judged
            ],
        )
