"""An effect that a model version has adopted, as it is told of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from app.effects.adopted.held import use_until
from app.effects.claim import AnsweredClaim, claim_of
from app.effects.effect import Effect
from app.effects.registry import explain
from app.effects.valid import LearntIn
from app.rounding import Parameters


@dataclass(frozen=True, slots=True, kw_only=True)
class AdoptedEffect(AnsweredClaim, published_as="AdoptedEffectAnswer"):
    """An effect that the version has adopted."""

    parameters: Annotated[Parameters, Field(examples=[{"time_constant_min": 41.2}])]
    """Parameters; their names say the unit"""
    standard_errors: Annotated[Parameters, Field(examples=[{"time_constant_min": 1.9}])]
    """One standard deviation of those that were estimated"""
    explanation: Annotated[str, Field(examples=["EZZ follows z-column 41 ± 2 min late"])]
    """What it is, in a sentence"""
    valid: LearntIn | None
    """Where it was learnt; null where an older version of this software adopted it"""
    found_by: int | None
    """Number of the analysis that found it; null where an older version of this software adopted
    it"""
    refitted_by: Sequence[int]
    """Numbers of the analyses that have fitted it anew since, in their order"""
    measure_again: str
    """Until when one that grows with time may be used, and what to measure then"""


def adopted_effect(effect: Effect) -> AdoptedEffect:
    """Describe an effect of a version."""
    origin = effect.provenance
    return AdoptedEffect(
        **claim_of(effect)._asdict(),
        parameters=effect.parameters,
        standard_errors=effect.standard_errors,
        explanation=explain(effect),
        valid=effect.learnt_in,
        found_by=origin.found_by if origin else None,
        refitted_by=origin.refitted_by if origin else (),
        measure_again=use_until(effect),
    )
