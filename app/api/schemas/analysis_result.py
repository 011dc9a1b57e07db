"""What an analysis found, over HTTP."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

from pydantic import Field

from app.api.schemas.adopted_effect import ValidAnswer
from app.api.schemas.base import Number, Schema, UtcTime

IN_ITS_UNIT: Final = "[µm; angular components µrad, squareness µm/m]"

Interval = Annotated[list[Number], Field(min_length=2, max_length=2)]


class FiguresAnswer(Schema):
    """Size of residuals over all values in µm."""

    rms_um: Number = Field(description="Root mean square of all visits together [µm]")
    p95_um: Number = Field(description="95th percentile of the size [µm]")
    holdout_rms_um: Number | None = Field(
        description="Root mean square on visits that took no part in what predicts them [µm]; "
        "null where nothing could be held out"
    )
    holdout_rms_ci95_um: Interval | None = Field(
        description="Its 95 % confidence interval, over visits [µm]"
    )


class ComponentFiguresAnswer(Schema):
    """One component, or one direction at points, before and after, in its own unit."""

    component: str = Field(description="Component code, or `points x`", examples=["EZZ"])
    unit: str = Field(description="Its unit", examples=["µm"])
    count: int = Field(description="Values that took part")
    before_rms: Number = Field(description=f"Root mean square before {IN_ITS_UNIT}")
    after_rms: Number = Field(description=f"Root mean square after {IN_ITS_UNIT}")
    before_p95: Number = Field(description=f"95th percentile of the size before {IN_ITS_UNIT}")
    after_p95: Number = Field(description=f"95th percentile of the size after {IN_ITS_UNIT}")
    holdout_before_rms: Number | None = Field(
        description=f"Root mean square before, on held-out visits {IN_ITS_UNIT}"
    )
    holdout_after_rms: Number | None = Field(
        description=f"Root mean square after, on held-out visits {IN_ITS_UNIT}"
    )
    noise: Number = Field(description=f"Standard deviation of one observation {IN_ITS_UNIT}")
    noise_origin: str = Field(description="`declared`, `replicates` or `residuals`")
    floor: Number | None = Field(
        description=f"What repeatability and set-up scatter alone would leave {IN_ITS_UNIT}"
    )


class EvidenceAnswer(Schema):
    """How sure an effect is; numbers without a unit, null where the readings alone show it."""

    likelihood_ratio: Number | None = Field(description="Twice the rise of the log likelihood")
    degrees_of_freedom: int | None = Field(description="Numbers that were fitted for it")
    two_ln_bayes_factor: Number | None = Field(
        description="Evidence against its absence; above 10 it is very strong"
    )
    p_global: Number | None = Field(
        description="Probability that noise surprises as much anywhere in the library"
    )
    calibration_slope: Number | None = Field(
        description="Measured against predicted contribution on held-out visits: 1 is right, "
        "0 is nothing; null where these visits do not excite it"
    )
    calibration_slope_error: Number | None = Field(description="Standard error of that slope")
    forward_slope: Number | None = Field(description="The same on the last visits, for trends")
    found_again_share: Number | None = Field(
        description="Share of the folds that find it again, or what it is tied with"
    )
    seen_in_readings: str | None = Field(
        None, description="What the readings alone show of it, where they do"
    )


class AlternativeAnswer(Schema):
    """Another explanation of the same residuals."""

    kind: str = Field(description="Kind of effect", examples=["additional-sensor"])
    variant: str = Field(description="Which form of the kind; empty where it has one only")
    components: list[str] = Field(description="On which components")
    sensors: list[str] = Field(description="Driven by which sensors")
    states: list[str] = Field(description="Driven by which states")
    evidence: Number = Field(description="Its 2 ln of the Bayes factor against no effect")
    behind: Number = Field(description="By how much less than the effect's")
    alias_share: Number = Field(description="Share of the effect that it can imitate")
    tied: bool = Field(description="Whether these observations cannot tell the two apart")
    separating_measurement: str | None = Field(description="What would tell them apart")


class StrongVisitAnswer(Schema):
    """A visit that carries much of the evidence."""

    label: str = Field(description="Label of the verification")
    time: UtcTime = Field(description="When it began, UTC")


class FoundEffectAnswer(Schema):
    """One effect that the model lacks."""

    kind: str = Field(description="Kind of effect", examples=["thermal-lag"])
    variant: str = Field(description="Which form of the kind; empty where it has one only")
    components: list[str] = Field(description="Components that it acts on", examples=[["EZZ"]])
    sensors: list[str] = Field(description="Sensors that drive it", examples=[["z-column"]])
    states: list[str] = Field(description="States that drive it")
    parameters: dict[str, Number] = Field(
        description="Parameters; the unit ends each name [µm; …]",
        examples=[{"time_constant_min": 41.2}],
    )
    standard_errors: dict[str, Number] = Field(
        description="One standard deviation of each parameter that was estimated [µm; …]"
    )
    before_rms_um: Number = Field(
        description="Root mean square of its components before it, on held-out visits where there "
        "are any [µm]; see `unit`"
    )
    after_rms_um: Number = Field(description="The same with it [µm]; see `unit`")
    unit: str = Field(description="Unit of the two", examples=["µm"])
    status: str = Field(
        description="What held-out visits say: `confirmed`, `suspected` or `not-confirmable`"
    )
    is_proxy: bool = Field(description="Whether unexplained structure remains beside it")
    evidence: EvidenceAnswer = Field(description="How sure it is")
    alternatives: list[AlternativeAnswer] = Field(description="What else it could be, ties first")
    explanation: str = Field(description="One plain sentence")
    strongest_visits: list[StrongVisitAnswer] = Field(
        description="The two visits that carry most of the evidence"
    )
    leverage: Number = Field(description="Their share of the evidence")
    leverage_warning: str | None = Field(
        description="Said where most of the evidence stands on two visits"
    )
    valid: ValidAnswer | None = Field(
        None, description="Where it was learnt: beyond it, it is held at the edge"
    )
    measure_again: str | None = Field(
        None, description="Until when one that grows with time may be used, and what to measure"
    )
    effect: dict[str, Any] = Field(description="What adoption stores")


class UnexplainedAnswer(Schema):
    """Structure that no effect explains."""

    component: str = Field(description="Where", examples=["EYZ"])
    unit: str = Field(description="The unit of its numbers", examples=["µm"])
    rms_um: Number = Field(description="Root mean square of what is left [µm]; see `unit`")
    noise_um: Number = Field(description="Standard deviation of one observation [µm]; see `unit`")
    leads: list[str] = Field(description="What it moves with")
    tests: list[str] = Field(description="Which tests found it")


class ExcludedAnswer(Schema):
    """Values that took no part, with the reason."""

    reason: str = Field(description="Why", examples=["frozen"])
    count: int = Field(description="How many values")


class NotTestedAnswer(Schema):
    """What these observations cannot show."""

    kind: str = Field(description="Kind of effect")
    on: str = Field(description="Of what")
    reason: str = Field(description="Why")


class SmallestSeenAnswer(Schema):
    """The smallest effect of one kind on one component that would have been seen."""

    kind: str = Field(description="Kind of effect")
    component: str = Field(description="On which component")
    unit: str = Field(description="Unit of its numbers", examples=["µm"])
    smallest_rms: Number = Field(
        description=f"Root mean square over the rows that it acts on {IN_ITS_UNIT}"
    )


class AnalysisResult(Schema):
    """What an analysis found; `plots` are the arrays of its report."""

    verdict: Literal["effects-found", "nothing-found", "unexplained"] = Field(
        description="`unexplained` where structure remains that no effect fits"
    )
    summary: str = Field(description="Two plain sentences")
    kinds: list[str] | None = Field(
        description="Kinds of effects that were looked for; null: all of them"
    )
    unit: str = Field(
        description="Of the figures over all values: µm, or that of the angles where no length "
        "was measured",
        examples=["µm"],
    )
    noise_um: Number | None = Field(
        description="Standard deviation of one observation [µm]; see `unit`"
    )
    floor_um: Number | None = Field(
        description="What repeatability and set-up scatter alone would leave [µm]; see `unit`"
    )
    before: FiguresAnswer = Field(description="Residuals of the model as it was")
    after: FiguresAnswer = Field(description="Residuals with the effects as they would be adopted")
    after_with_maps_refitted: FiguresAnswer | None = Field(
        description="The same where maps are also corrected within their own uncertainty"
    )
    p_global: Number = Field(
        description="Probability that noise alone surprises as much as the strongest candidate"
    )
    visits: int = Field(description="Visits that took part")
    values: int = Field(description="Values that took part")
    components: list[ComponentFiguresAnswer] = Field(description="By component, largest first")
    effects: list[FoundEffectAnswer] = Field(description="Effects that the model lacks")
    unexplained: list[UnexplainedAnswer] = Field(description="What no effect explains")
    excluded: list[ExcludedAnswer] = Field(description="What took no part")
    not_testable: list[NotTestedAnswer] = Field(description="What could not be tested")
    detectable: list[SmallestSeenAnswer] = Field(description="What would have been seen")
    what_next: list[str] = Field(description="What to measure or to do")
    plots: dict[str, Any] = Field(description="Arrays of the report's plots")
