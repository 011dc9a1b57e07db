"""What the search found, as effects with their rivals, evidence and sentences."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from app.arrays import FloatArray, rms
from app.effects.adopted.held import use_until
from app.effects.claim import claim_of
from app.effects.effect import Effect
from app.effects.hypothesis import Hypothesis, series_text
from app.effects.registry import explain, kind_of, separating_measurement
from app.identification.analysis.before_after import lengths
from app.identification.analysis.decide import Decision, Help
from app.identification.analysis.finished_search import FinishedSearch
from app.identification.analysis.found_effect import Alternative, Evidence, FoundEffect, StrongVisit
from app.identification.analysis.reading_faults import ReadingFaults
from app.identification.residuals.residuals import channel_unit
from app.search.findings import FoundTerm, Rival, Status
from app.units import Unit, utc_time

HIGH_LEVERAGE: Final = 0.6
"""From this share of the evidence on two visits on, a warning is given."""

PROXY: Final = "proxy for something unexplained: "
"""Before the sentence of an effect that was found beside structure that no effect explains."""

MOST_ALTERNATIVES: Final = 12

AS_LATE_AS_TRIED: Final = (
    "its time constant is the longest that was tried, so something slower or of another kind may "
    "fit better"
)
"""A doubt of what ends where the search ends."""

HARDLY_SEEN: Final = (
    "; set-ups with zeros of their own hardly show what it does at all positions alike, which is "
    "taken to be not much larger than the rest: to know it, measure one position with the datum "
    "`absolute`, cold and hot"
)
"""After the sentence of an effect of which the set-ups hide a part."""


def found_effects(
    finished: FinishedSearch, effects: Sequence[Effect], decision: Decision
) -> list[FoundEffect]:
    """Describe every found term.

    Parameters
    ----------
    effects, decision
        As adoption would store them, and whether they help, in the order of the terms.
    """
    return [
        _found_effect(finished, *parts_of_effect, is_unsure=i in decision.unsure)
        for i, parts_of_effect in enumerate(
            zip(effects, finished.findings.terms, decision.helps, strict=True)
        )
    ]


def faults_of_readings(
    finished: FinishedSearch, faults: ReadingFaults, before: FloatArray
) -> list[FoundEffect]:
    """Describe the sensors that read wrong by their own record.

    Parameters
    ----------
    before : ndarray, shape (n,) [the channels' units]
        Residuals with the faulty readings believed; NaN where they are not known.
    """
    names = np.array(finished.residuals.rows.channels)[finished.rows.channel]
    described = []
    for effect, words in zip(faults.effects, faults.words, strict=True):
        rows_of_effect = finished.use & np.isin(names, effect.components)
        rows_of_effect = rows_of_effect if rows_of_effect.any() else finished.use
        in_um = rows_of_effect & lengths(finished.residuals)
        rows_of_effect = in_um if in_um.any() else rows_of_effect
        sizes = [
            rms(finished.from_zero(values, rows_of_effect))
            for values in (
                np.where(np.isnan(before), finished.rows.values, before),
                finished.rows.values,
            )
        ]
        described.append(
            FoundEffect(
                effect=finished.with_ranges(effect),
                before_rms=sizes[0],
                after_rms=sizes[1],
                unit=channel_unit(str(names[rows_of_effect][0])).symbol,
                status=str(Status.CONFIRMED),
                helps=True,
                evidence=Evidence(seen_in_readings=words),
                explanation=explain(effect),
            )
        )
    return described


def _found_effect(
    finished: FinishedSearch, effect: Effect, term: FoundTerm, helps: Help, *, is_unsure: bool
) -> FoundEffect:
    before, after, unit = _sizes(finished, effect, term)
    is_proxy = finished.is_proxy(effect, term)
    confirmed = term.status is Status.CONFIRMED
    own_doubts = (
        kind_of(effect.kind).doubt(effect),
        AS_LATE_AS_TRIED if finished.is_slowest(term) else None,
    )
    is_open = is_unsure or not finished.is_name_sure(effect, term)
    return FoundEffect(
        effect=effect,
        before_rms=before,
        after_rms=after,
        unit=unit,
        status=str(Status.SUSPECTED if confirmed and is_open else term.status),
        helps=helps.helps,
        why_not=helps.why_not,
        is_proxy=is_proxy,
        doubts=(*term.doubts, *filter(None, own_doubts)),
        evidence=_evidence(term),
        alternatives=_alternatives(finished, term),
        explanation=f"{PROXY if is_proxy else ''}{explain(effect)}{_other_course(finished, term)}"
        f"{HARDLY_SEEN if finished.expected_of(term).is_hardly_known else ''}",
        strongest_visits=tuple(_visit(finished, v) for v in term.strongest_visits),
        leverage=term.leverage,
        leverage_warning=_leverage_warning(finished, term),
        measure_again=use_until(effect) or None,
    )


def _other_course(finished: FinishedSearch, term: FoundTerm) -> str:
    """Say how else the effect may come late, where these values do not tell."""
    hypothesis = finished.hypotheses[term.key]
    keys = {form.key for form in hypothesis.forms}
    tied = (rival for rival in term.rivals if rival.key in keys and rival.tied)
    return "".join(
        f"; {series_text(hypothesis.nonlinear, rival.theta)} fit as well"
        for rival in tied
        if hypothesis.nonlinear is not None and rival.theta is not None
    )


def _evidence(term: FoundTerm) -> Evidence:
    return Evidence(
        likelihood_ratio=term.likelihood_ratio,
        degrees_of_freedom=term.degrees_of_freedom,
        two_ln_bayes_factor=term.evidence,
        p_global=term.global_p,
        calibration_slope=term.slope.value if term.slope else None,
        calibration_slope_error=term.slope.error if term.slope else None,
        forward_slope=term.forward_slope.value if term.forward_slope else None,
        found_again_share=term.inclusion,
    )


def _alternatives(finished: FinishedSearch, term: FoundTerm) -> tuple[Alternative, ...]:
    """Ties first, then what else comes closest."""
    hypothesis = finished.hypotheses[term.key]
    rivals = sorted(term.rivals, key=lambda r: (not r.tied, r.behind))[:MOST_ALTERNATIVES]
    return tuple(_alternative(hypothesis, finished.hypotheses[r.key], term, r) for r in rivals)


def _alternative(
    hypothesis: Hypothesis, other: Hypothesis, term: FoundTerm, rival: Rival
) -> Alternative:
    return Alternative(
        *claim_of(other),
        evidence=term.evidence - rival.behind,
        behind=rival.behind,
        alias_share=rival.alias_share,
        tied=rival.tied,
        with_offset=rival.with_offset,
        separating_measurement=separating_measurement(hypothesis, other) if rival.tied else None,
    )


def _sizes(finished: FinishedSearch, effect: Effect, term: FoundTerm) -> tuple[float, float, str]:
    """Residuals where the effect acts, before and after all effects, and their unit."""
    names = finished.residuals.rows.channels
    channels = finished.own_channels(effect, term)
    in_um = [c for c in channels if channel_unit(names[c]) is Unit.UM]
    chosen = finished.use & np.isin(finished.rows.channel, in_um or channels)
    predicted = finished.findings.adopted
    predicted_rows = chosen & np.isfinite(predicted)
    if predicted_rows.any():
        chosen, explained = predicted_rows, predicted
    else:
        explained = sum((finished.explained(e) for e in finished.effects()), np.zeros(len(chosen)))
    sizes = [
        rms(finished.from_zero(finished.rows.values - part, chosen)) for part in (0.0, explained)
    ]
    return sizes[0], sizes[1], channel_unit(names[(in_um or channels)[0]]).symbol


def _visit(finished: FinishedSearch, number: int) -> StrongVisit:
    rows = finished.residuals.rows
    of_visit = rows.visit == number
    label = rows.verifications[int(rows.verification[of_visit][0])].label
    return StrongVisit(label, utc_time(float(rows.times_s[of_visit].min())))


def _leverage_warning(finished: FinishedSearch, term: FoundTerm) -> str | None:
    if term.leverage < HIGH_LEVERAGE or len(term.strongest_visits) < 2:
        return None
    labels = " and ".join(repr(_visit(finished, v).label) for v in term.strongest_visits)
    return (
        f"two visits ({labels}) carry {term.leverage:.0%} of the evidence: repeat such conditions "
        "before relying on it"
    )
