"""One effect that an analysis found or fitted anew: what it is, how sure, what else it may be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from app.answer import Answer, Codes, Sensors, UnitSymbol, shown
from app.effects.claim import AnsweredClaim
from app.effects.effect import StoredEffect
from app.effects.valid import LearntIn
from app.errors import list_names

Parameters: TypeAlias = Annotated[
    Mapping[str, float], Field(examples=[{"time_constant_min": 41.2}])
]


@dataclass(frozen=True, slots=True)
class Evidence(Answer, published_as="EvidenceAnswer"):
    """How sure an effect is; numbers without a unit, null where the readings alone show it."""

    likelihood_ratio: float | None = None
    """Twice the rise of the log likelihood"""

    degrees_of_freedom: int | None = None
    """Numbers that were fitted for it"""

    two_ln_bayes_factor: float | None = None
    """Evidence for it against no effect, 2 ln of the Bayes factor, with the prior spread evenly
    within its kind; above 10 it is very strong"""

    p_global: float | None = None
    """Probability that noise alone gives as strong a candidate anywhere in the library"""

    calibration_slope: float | None = None
    """Slope of measured against predicted contribution on held-out visits: 1 if they show all of
    it, 0 if nothing; null where it was never found without them"""

    calibration_slope_error: float | None = None
    """Standard error of that slope"""

    forward_slope: float | None = None
    """The same slope on the last visits, predicted from the earlier ones, for trends"""

    found_again_share: float | None = None
    """Share of the hold-out splits in which it, or what it is tied with, is found again"""

    seen_in_readings: str | None = None
    """What the readings alone show of it; null where they do not show it"""


@dataclass(frozen=True, slots=True)
class Alternative(AnsweredClaim, published_as="AlternativeAnswer"):
    """Another explanation of the same residuals."""

    evidence: float
    """Its evidence against no effect, 2 ln of the Bayes factor"""

    behind: float
    """How much weaker that is than the effect's own evidence"""

    alias_share: float
    """Share of the effect that it can imitate"""

    tied: bool
    """Whether these observations cannot tell the two apart"""

    with_offset: bool
    """Whether it comes this close only with a constant added to it"""

    separating_measurement: str | None = None
    """What would tell them apart"""


@dataclass(frozen=True, slots=True)
class StrongVisit(Answer, published_as="StrongVisitAnswer"):
    """A visit that carries much of the evidence."""

    label: str
    """Label of the verification"""

    time: datetime
    """When it began, UTC"""


@dataclass(frozen=True, slots=True)
class Cause(Answer, published_as="CauseAnswer"):
    """How much a kind of drivers moves a component, of many that drive it together."""

    names: tuple[str, ...]
    """Sensors and states that it is about; empty where it is about all or none"""

    sentence: str
    """One plain sentence"""


@dataclass(frozen=True, eq=False, slots=True, kw_only=True)
class FoundEffect(Answer, published_as="FoundEffectAnswer"):
    """One effect that the model lacks."""

    effect: StoredEffect
    """What adoption stores"""

    before_rms: Annotated[float, Field(alias="before_rms_um")]
    """Root mean square of the residuals where it acts, before any found effect, on held-out visits
    where there are any [µm]; see `unit`"""

    after_rms: Annotated[float, Field(alias="after_rms_um")]
    """The same with all found effects [µm]; see `unit`"""

    unit: UnitSymbol
    """Unit of these two: µm where the effect acts on any length"""

    status: str
    """How sure its name is: `confirmed`, `suspected` or `not-confirmable`"""

    helps: bool
    """Whether held-out visits show that it helps, and none gets markedly worse; such effects are
    adopted unless the request names effects"""

    why_not: str | None = None
    """Why it is not known to help; null where it helps"""

    is_proxy: bool = False
    """Whether unexplained structure remains beside it"""

    doubts: tuple[str, ...] = ()
    """How the measured values depart from it, beyond noise: its name is then not `confirmed`. Empty
    where they fit it"""

    evidence: Evidence
    """How strong the evidence for it is"""

    alternatives: tuple[Alternative, ...] = ()
    """What else it could be, ties first"""

    explanation: str
    """One plain sentence"""

    strongest_visits: tuple[StrongVisit, ...] = ()
    """The two visits that carry most of the evidence"""

    leverage: float = 0.0
    """Their share of the evidence"""

    leverage_warning: str | None = None
    """A warning where two visits carry most of the evidence; else null"""

    measure_again: str | None = None
    """For an effect that grows with time: until when it may be used, and what to measure by then"""

    causes: tuple[Cause, ...] = ()
    """What can be said of its causes where many drive it together; empty for other effects"""

    @shown
    def kind(self) -> Annotated[str, Field(examples=["thermal-lag"])]:
        """Kind of effect."""
        return self.effect.kind

    @shown
    def variant(self) -> str:
        """Which form of the kind; empty where it has one only."""
        return self.effect.variant

    @shown
    def components(self) -> Codes:
        """Components that it acts on."""
        return self.effect.components

    @shown
    def sensors(self) -> Sensors:
        """Sensors that drive it."""
        return self.effect.sensors

    @shown
    def states(self) -> tuple[str, ...]:
        """States that drive it."""
        return self.effect.states

    @shown
    def parameters(self) -> Parameters:
        """Parameters; the unit ends each name [µm; …]."""
        return self.effect.parameters

    @shown
    def standard_errors(self) -> Mapping[str, float]:
        """One standard deviation of each parameter that was estimated [µm; …]."""
        return self.effect.standard_errors

    @shown
    def valid(self) -> LearntIn | None:
        """The ranges in which it was learnt; beyond them it is held at the edge."""
        return self.effect.learnt_in

    @property
    def doubt(self) -> str | None:
        """Why its name is not sure, in one sentence; None where nothing speaks against it."""
        if not self.doubts:
            return None
        return (
            f"the measured values do not quite fit this effect: {list_names(self.doubts)}; the "
            "cause may be another one that resembles it"
        )

    @property
    def ties(self) -> tuple[Alternative, ...]:
        """The alternatives that these observations cannot tell from it."""
        return tuple(a for a in self.alternatives if a.tied)


@dataclass(frozen=True, eq=False, slots=True)
class RefittedEffect(Answer, published_as="RefittedEffectAnswer"):
    """What adopting the effects that help does to an effect that the model already has."""

    effect: StoredEffect
    """The effect as the model has it"""

    becomes: StoredEffect | None
    """What adoption stores in its place; null where it is dropped or left as it is"""

    outcome: Literal["refitted", "dropped", "left"]
    """`refitted`: together with the found effects that help; `dropped`: no longer worth its place
    beside them; `left`: as it is"""

    is_changed: bool
    """Whether it is dropped, or its parameters change by more than their uncertainty"""

    explanation: str
    """What it was and what it becomes, or why it stays, in one plain sentence"""

    @shown
    def kind(self) -> Annotated[str, Field(examples=["thermal-lag"])]:
        """Kind of effect."""
        return self.effect.kind

    @shown
    def components(self) -> Codes:
        """Components that it acts on."""
        return self.effect.components

    @shown
    def parameters(self) -> Parameters:
        """Parameters as the model has them; the unit ends each name [µm; …]."""
        return self.effect.parameters

    @shown
    def refitted_parameters(self) -> Parameters | None:
        """Parameters after refitting [µm; …]; null where it is dropped or left."""
        return None if self.becomes is None else self.becomes.parameters

    @shown
    def refitted_standard_errors(self) -> Parameters | None:
        """One standard deviation of each [µm; …]; null where it is dropped or left."""
        return None if self.becomes is None else self.becomes.standard_errors
