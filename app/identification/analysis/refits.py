"""Effects that a model has adopted before, fitted anew beside what an analysis finds.

What was learnt first was learnt alone: part of what came later is in its size. So every analysis
that has an effect's own measurements fits it again, with all others and with the maps' freedom.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import chdtrc

from app.arrays import FloatArray
from app.effects.adopted.contributions import contributions
from app.effects.claim import claim_of
from app.effects.effect import Effect
from app.effects.hypothesis import Hypothesis
from app.effects.kinds.response import Response
from app.effects.projection import Projection
from app.effects.registry import explain
from app.errors import list_names
from app.identification.analysis.finished_search import FinishedSearch
from app.identification.analysis.found_effect import RefittedEffect
from app.identification.campaign import Campaign
from app.search.candidate import Candidate, Known, KnownTerm
from app.search.findings import FoundTerm

CHANGED: Final = 0.01
"""Probability below which what an effect was is compatible with what it is now."""

UNKNOWN: Final = "it is not known in which measurements it was found"
NOT_TESTED: Final = "these observations, or the kinds that were looked for, cannot test it"
NOT_SHOWN: Final = "these observations do not show it"
NOT_BETTER: Final = "held-out set-ups do not show that refitting it would make them better"
BESIDE_A_MISTAKE: Final = "a mistake in the data was found, which is to be corrected first"
BESIDE_OTHERS: Final = "refitting it would make held-out set-ups worse"


@dataclass(frozen=True, eq=False)
class Adopted:
    """An effect of the model that can be fitted anew, with its number among the model's."""

    number: int
    effect: Effect
    hypothesis: Hypothesis
    theta: float | None


@dataclass(frozen=True, eq=False)
class AdoptedBefore:
    """What the model has: effects that are fitted anew, and those that stay, each with a reason.

    Parameters
    ----------
    explained : ndarray, shape (n,)
        What those that are fitted anew add to the model's prediction of each row.
    """

    anew: tuple[Adopted, ...]
    left: tuple[tuple[Effect, str], ...]
    explained: FloatArray

    def known(self, candidates: Sequence[Candidate]) -> Known | None:
        """Hand them to the search, as those of its candidates that they are; None without any."""
        if not self.anew:
            return None
        of_key = {candidate.key: candidate for candidate in candidates}
        terms = [KnownTerm(of_key[refit.hypothesis.key], refit.theta) for refit in self.anew]
        return Known(terms, self.explained)

    def staying(self, why: str) -> AdoptedBefore:
        """Leave those that could be fitted anew as they are, for a reason."""
        stay = ((refit.effect, why) for refit in self.anew)
        return AdoptedBefore((), (*self.left, *stay), np.zeros_like(self.explained))

    def beside(self, candidates: Sequence[Candidate]) -> list[Candidate]:
        """List what may be looked for where they stay: they themselves would count twice."""
        keys = {refit.hypothesis.key for refit in self.anew}
        return [candidate for candidate in candidates if candidate.key not in keys]


def adopted_before(
    campaign: Campaign, projection: Projection, hypotheses: Mapping[str, Hypothesis]
) -> AdoptedBefore:
    """Sort the model's effects into those that a campaign can fit anew and those that stay.

    An effect whose own measurements are not all in the campaign stays as it is: what it was
    learnt from would not be weighed. Responses are learnt anew by themselves.

    Parameters
    ----------
    projection
        The rows that take part.
    """
    anew: list[Adopted] = []
    staying: list[tuple[Effect, str]] = []
    for number, effect in enumerate(campaign.effects):
        if effect.kind == Response.kind or effect.adds_nothing:
            continue
        hypothesis = hypotheses.get(claim_of(effect).key)
        why = _why_left(campaign, effect, hypothesis)
        theta = None if why or hypothesis is None else hypothesis.theta_of(effect)
        if not why and hypothesis is not None:
            why = "" if projection.parts(hypothesis.unit_terms(theta)) else NOT_SHOWN
        if why or hypothesis is None:
            staying.append((effect, why))
        else:
            anew.append(Adopted(number, effect, hypothesis, theta))
    rest = [e for i, e in enumerate(campaign.effects) if i not in {refit.number for refit in anew}]
    explained = np.zeros(len(projection.rows))
    if anew:
        whole, others = (contributions(projection, part) for part in (campaign.effects, rest))
        explained = whole.errors - others.errors
    return AdoptedBefore(tuple(anew), tuple(staying), explained)


def _why_left(campaign: Campaign, effect: Effect, hypothesis: Hypothesis | None) -> str:
    if effect.provenance is None:
        return UNKNOWN
    others = set(effect.provenance.verifications) - set(campaign.verification_ids)
    if others:
        numbers = list_names(map(str, sorted(others)), 6)
        return f"it was found in measurements that are not among these: verification {numbers}"
    if hypothesis is None:
        return NOT_TESTED
    if hypothesis.nonlinear is not None and hypothesis.nonlinear.name not in effect.parameters:
        return NOT_TESTED
    return ""


def refitted_effects(
    finished: FinishedSearch,
    before: AdoptedBefore,
    refitted: Sequence[FoundTerm],
    *,
    is_refused: bool,
) -> tuple[RefittedEffect, ...]:
    """Describe what becomes of the effects that the model has.

    Parameters
    ----------
    refitted
        Those that are fitted anew, as they are now.
    is_refused
        Whether they stay as they were, because set-ups held out would get worse.
    """
    now = {term.origin: term for term in refitted}
    described = [_staying_effect(effect, why) for effect, why in before.left]
    for number, adopted in enumerate(before.anew):
        term = now.get(number)
        if is_refused:
            described.append(_staying_effect(adopted.effect, BESIDE_OTHERS))
        elif term is None:
            described.append(
                RefittedEffect(
                    effect=adopted.effect,
                    becomes=None,
                    outcome="dropped",
                    is_changed=True,
                    explanation=(
                        f"{_named(adopted.effect)} is dropped: with the other effects beside it, "
                        "it "
                        f"is no longer worth its place ({explain(adopted.effect)})"
                    ),
                )
            )
        else:
            anew = replace(finished.effect_of(term), provenance=adopted.effect.provenance)
            was, becomes = explain(adopted.effect), explain(anew)
            outcome = f"{was} → {becomes}" if was != becomes else f"it stays as it was ({becomes})"
            described.append(
                RefittedEffect(
                    effect=adopted.effect,
                    becomes=anew,
                    outcome="refitted",
                    is_changed=_is_changed(adopted, anew),
                    explanation=f"{_named(adopted.effect)} refitted: {outcome}",
                )
            )
    return tuple(described)


def effects_after(
    model: Sequence[Effect], refitted: Sequence[RefittedEffect], new: Sequence[Effect]
) -> list[Effect]:
    """List a model's effects after adoption: refitted ones in their places, then the new ones.

    Parameters
    ----------
    refitted
        What becomes of them; what is not named stays.
    """
    after: list[Effect] = []
    for effect in model:
        refit = next((r for r in refitted if r.effect == effect and r.outcome != "left"), None)
        if refit is None:
            after.append(effect)
        elif refit.becomes is not None:
            after.append(refit.becomes)
    return [*after, *new]


def _staying_effect(effect: Effect, why: str) -> RefittedEffect:
    return RefittedEffect(
        effect=effect,
        becomes=None,
        outcome="left",
        is_changed=False,
        explanation=f"{_named(effect)} stays as it is: {why}",
    )


def _named(effect: Effect) -> str:
    return f"{effect.kind} of {list_names(effect.components, 3)}"


def _is_changed(adopted: Adopted, anew: Effect) -> bool:
    """Whether an effect has moved by more than what its parameters are unsure by."""
    moved = [
        ((value - adopted.effect.parameters[name]) / error) ** 2
        for name, value in anew.parameters.items()
        if name in adopted.effect.parameters
        and (error := anew.standard_errors.get(name, 0.0)) > 0.0
    ]
    return bool(moved) and bool(chdtrc(len(moved), sum(moved)) < CHANGED)
