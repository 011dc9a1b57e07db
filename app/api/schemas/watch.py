"""Whether a machine still is as its model says, over HTTP."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Self

from pydantic import Field

from app.api.schemas.base import Number, Schema, UtcTime
from app.identification.watch.watching import FALSE_ALARM, LIMIT, Followed

if TYPE_CHECKING:
    from app.services.verifications import Watch


class JudgedVerification(Schema):
    """One verification of the sequence."""

    verification: int = Field(description="Number of the verification")
    label: str = Field(description="Its name", examples=["night shift"])
    last_at: UtcTime = Field(description="Time of its last observation, UTC")
    status: str = Field(description="`within`, `beyond` or `not-judged`")
    evidence: Number | None = Field(
        description="Evidence from all verifications up to it, as an e-value"
    )


class WatchAnswer(Schema):
    """Where the sequential test of the active version stands."""

    model_version: int = Field(description="The active version")
    status: Literal["within", "beyond", "no-verification"] = Field(
        description="`no-verification` before the first one was judged"
    )
    beyond_since: UtcTime | None = Field(
        description="Time of the visit that first exceeded the limit, UTC; null: none did"
    )
    evidence: Number = Field(
        description="Evidence from all verifications so far, as an e-value; 1 without any"
    )
    limit: Number = Field(
        description="Evidence that an unchanged machine ever reaches only with probability "
        "`false_alarm`"
    )
    false_alarm: Number = Field(
        description="Probability that an unchanged machine is ever called changed"
    )
    updated_at: UtcTime | None = Field(description="When the last verification was judged, UTC")
    contradiction: str | None = Field(
        description="What is said where nearly all lengths contradict the repeatability that is "
        "stated, and what that does to the watch; null where they do not"
    )
    numbers: list[Followed] = Field(description="What is followed, strongest evidence first")
    verifications: list[JudgedVerification] = Field(description="What was judged, oldest first")

    @classmethod
    def of(cls, watch: Watch) -> Self:
        """Show a watch."""
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
            contradiction=watch.state.contradiction(),
            numbers=watch.state.all_followed(),
            verifications=[
                JudgedVerification(
                    verification=v.id,
                    label=v.label,
                    last_at=v.last_at,
                    status=v.judgement.status,
                    evidence=v.judgement.evidence,
                )
                for v in watch.judged
                if v.judgement is not None
            ],
        )
