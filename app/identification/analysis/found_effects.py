"""What the search found, as effects with their rivals, evidence and sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray
from app.effects.adopted.held import use_until
from app.effects.adopted.learnt_ranges import use_until_s, with_ranges
from app.effects.effect import Effect
from app.effects.hypothesis import Estimate, Hypothesis
from app.effects.projection import sum_of_terms
from app.effects.registry import explain, separating_measurement
from app.identification.analysis.analysis import Alternative, Evidence, FoundEffect, StrongVisit
from app.identification.analysis.before_after import lengths, unknown_zeros, without_zeros
from app.identification.analysis.reading_faults import ReadingFaults
from app.identification.residuals.residuals import Residuals, channel_unit
from app.search.figures import rms
from app.search.findings import Findings, FoundTerm, Rival, Status
from app.search.rows import Rows
from app.units import Unit, utc_time

HIGH_LEVERAGE: Final = 0.6
"""From this share of the evidence on two visits on, a warning is given."""

PROXY: Final = "Stands for something unexplained: "
"""Before the sentence of an effect that was found beside structure that no effect explains."""

MOST_ALTERNATIVES: Final = 12


@dataclass(frozen=True, eq=False)
class Found:
    """A finished search beside the rows that it looked at.

    Parameters
    ----------
    residuals, rows
        The rows.
    findings
        What was found.
    use : ndarray, shape (n,)
        Which rows took part.
    hypotheses
        Key to hypothesis.
    """

    residuals: Residuals
    rows: Rows
    findings: Findings
    use: BoolArray
    hypotheses: Mapping[str, Hypothesis]

    @cached_property
    def zeros(self) -> list[IntArray]:
        """Rows of each unknown zero."""
        return unknown_zeros(self.residuals, self.rows)

    def effects(self) -> list[Effect]:
        """Make the effects that adoption would store, in the order of the terms."""
        return [self._effect(term) for term in self.findings.terms]

    def with_ranges(self, effect: Effect) -> Effect:
        """Set beside an effect where these rows show it."""
        return with_ranges(effect, self.residuals.projection, self.use)

    def _effect(self, term: FoundTerm) -> Effect:
        hypothesis = self.hypotheses[term.key]
        effect = self.with_ranges(
            hypothesis.fitted(
                Estimate(term.theta, term.theta_error, term.amplitudes, term.covariance)
            )
        )
        if effect.valid is None:
            return effect
        until_s = use_until_s(
            effect.valid,
            hypothesis.unit_terms(term.theta),
            term.amplitudes,
            term.covariance,
            self.residuals.projection,
            {channel: noise.fitted for channel, noise in self.findings.noise.items()},
        )
        return replace(effect, valid=replace(effect.valid, use_until_s=until_s))

    def explained(self, effect: Effect) -> FloatArray:
        """Say what an effect adds to each row, shape (n,) [the channels' units]."""
        own = sum_of_terms(self.residuals.projection, effect.terms)
        return np.nan_to_num(own, nan=0.0)


def found_effects(found: Found, effects: Sequence[Effect]) -> list[FoundEffect]:
    """Describe every found term.

    Parameters
    ----------
    found
        The finished search.
    effects
        Its effects, as `Found.effects` makes them.

    Returns
    -------
    list of FoundEffect
    """
    return [
        _found_effect(found, effect, term)
        for effect, term in zip(effects, found.findings.terms, strict=True)
    ]


def faults_of_readings(
    found: Found, faults: ReadingFaults, before: FloatArray
) -> list[FoundEffect]:
    """Describe the sensors that read wrong by their own record.

    Parameters
    ----------
    found
        The finished search, on readings without the faults.
    faults
        What was seen.
    before : ndarray, shape (n,) [the channels' units]
        Residuals with the faulty readings believed; NaN where they are not known.

    Returns
    -------
    list of FoundEffect
    """
    names = np.array(found.residuals.rows.channels)[found.rows.channel]
    described = []
    for effect, words in zip(faults.effects, faults.words, strict=True):
        own = found.use & np.isin(names, effect.components)
        own = own if own.any() else found.use
        in_um = own & lengths(found.residuals)
        own = in_um if in_um.any() else own
        sizes = [
            rms(without_zeros(found.zeros, np.where(own, values, np.nan))[own])
            for values in (np.where(np.isnan(before), found.rows.values, before), found.rows.values)
        ]
        described.append(
            FoundEffect(
                effect=found.with_ranges(effect),
                before_rms_um=sizes[0],
                after_rms_um=sizes[1],
                unit=channel_unit(str(names[own][0])).symbol,
                status=str(Status.CONFIRMED),
                is_proxy=False,
                evidence=Evidence(seen_in_readings=words),
                alternatives=(),
                explanation=explain(effect),
                strongest_visits=(),
                leverage=0.0,
                leverage_warning=None,
                measure_again=None,
            )
        )
    return described


def is_unexplained_at(findings: Findings, channels: Sequence[int]) -> bool:
    """Say whether structure remains in any of some channels.

    Parameters
    ----------
    findings
        What was found.
    channels
        Their numbers.
    """
    left = {one.channel for one in findings.unexplained}
    return None in left or bool(left.intersection(channels))


def _found_effect(found: Found, effect: Effect, term: FoundTerm) -> FoundEffect:
    before, after, unit = _sizes(found, effect, term)
    is_proxy = is_unexplained_at(found.findings, _own_channels(found, effect, term))
    confirmed = term.status is Status.CONFIRMED
    return FoundEffect(
        effect=effect,
        before_rms_um=before,
        after_rms_um=after,
        unit=unit,
        status=str(Status.SUSPECTED if is_proxy and confirmed else term.status),
        is_proxy=is_proxy,
        evidence=_evidence(term),
        alternatives=_alternatives(found, term),
        explanation=f"{PROXY if is_proxy else ''}{explain(effect)}",
        strongest_visits=tuple(_visit(found, v) for v in term.strongest_visits),
        leverage=term.leverage,
        leverage_warning=_leverage_warning(found, term),
        measure_again=use_until(effect) or None,
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


def _alternatives(found: Found, term: FoundTerm) -> tuple[Alternative, ...]:
    """Ties first, then what else comes closest."""
    own = found.hypotheses[term.key]
    rivals = sorted(term.rivals, key=lambda r: (not r.tied, r.behind))[:MOST_ALTERNATIVES]
    return tuple(_alternative(own, found.hypotheses[r.key], term, r) for r in rivals)


def _alternative(own: Hypothesis, other: Hypothesis, term: FoundTerm, rival: Rival) -> Alternative:
    return Alternative(
        kind=other.kind,
        variant=other.variant,
        components=other.components,
        sensors=other.sensors,
        states=other.states,
        evidence=term.evidence - rival.behind,
        behind=rival.behind,
        alias_share=rival.alias_share,
        tied=rival.tied,
        separating_measurement=separating_measurement(own, other) if rival.tied else None,
    )


def _sizes(found: Found, effect: Effect, term: FoundTerm) -> tuple[float, float, str]:
    """Residuals where the effect acts, before and after all effects, and their unit."""
    names = found.residuals.rows.channels
    own = _own_channels(found, effect, term)
    in_um = [c for c in own if channel_unit(names[c]) is Unit.UM]
    chosen = found.use & np.isin(found.rows.channel, in_um or own)
    predicted = found.findings.adopted
    held = chosen & np.isfinite(predicted)
    if held.any():
        chosen, explained = held, predicted
    else:
        explained = sum((found.explained(e) for e in found.effects()), np.zeros(len(chosen)))
    sizes = [
        rms(without_zeros(found.zeros, np.where(chosen, found.rows.values - part, np.nan))[chosen])
        for part in (0.0, explained)
    ]
    return sizes[0], sizes[1], channel_unit(names[(in_um or own)[0]]).symbol


def _own_channels(found: Found, effect: Effect, term: FoundTerm) -> list[int]:
    """The effect's own components where they were observed by themselves, else all channels."""
    names = found.residuals.rows.channels
    return [c for c in term.channels if names[c] in effect.components] or list(term.channels)


def _visit(found: Found, number: int) -> StrongVisit:
    rows = found.residuals.rows
    own = rows.visit == number
    label = rows.verifications[int(rows.verification[own][0])].label
    return StrongVisit(label, utc_time(float(rows.times_s[own].min())))


def _leverage_warning(found: Found, term: FoundTerm) -> str | None:
    if term.leverage < HIGH_LEVERAGE or len(term.strongest_visits) < 2:
        return None
    labels = " and ".join(repr(_visit(found, v).label) for v in term.strongest_visits)
    return (
        f"{term.leverage:.0%} of the evidence stands on two visits ({labels}): "
        "repeat such conditions before relying on it"
    )
