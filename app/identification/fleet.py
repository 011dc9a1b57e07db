"""What the analyses of many machines say together: who drifts, and what sisters share.

Sisters are machines that state the same configuration, the same travels and the same sensors.
An effect that was found on one of them is a candidate for the others, and is tried there as it
stands: found on some, tried on the rest, and never more is said.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

from app.answer import Answer, UnitSymbol
from app.effects.claim import AnsweredClaim, claim_of
from app.effects.registry import explain, kind_of
from app.errors import counted, list_names
from app.identification.analysis.analysis import Analysis, Verdict
from app.identification.analysis.found_effect import FoundEffect, Parameters
from app.identification.analysis.tried_effect import TriedEffect

Likeness: TypeAlias = tuple[str, tuple[tuple[str, float, float], ...], tuple[str, ...]]
"""Configuration, travels [mm] and sensors."""


@dataclass(frozen=True, eq=False)
class Member:
    """A machine of a fleet, with what its analysis found.

    Parameters
    ----------
    watch
        `within` or `beyond`, None where no verification was judged.
    result
        None where there is none: `why_not` then says why.
    """

    id: str
    name: str
    likeness: Likeness
    watch: str | None
    has_verifications: bool = False
    analysis: int | None = None
    result: Analysis | None = None
    why_not: str | None = None


@dataclass(frozen=True, slots=True)
class Trial:
    """An effect to be tried on a sister: where it was found, its place there, and on whom."""

    machine: str
    analysis: int
    effect: int
    on: str


@dataclass(frozen=True, slots=True)
class FleetMachine(Answer):
    """One machine of the fleet."""

    machine: str
    """Its id"""

    name: str
    """Its name for people"""

    sisters: tuple[str, ...]
    """Machines that state the same configuration, travels and sensors"""

    watch: str | None
    """`within` or `beyond` its limits, by the latest verifications; null where none was judged"""

    drifts: str | None
    """Why it no longer agrees with its model; null where there is no sign of that"""

    analysis: int | None
    """Number of its analysis; null where there is none"""

    verdict: Verdict | None
    """Its verdict; null where there is no result"""

    why_not: str | None
    """Why it was not judged; null where it was"""

    unit: UnitSymbol | None
    """Unit of the figures"""

    before_rms_um: float | None
    """Root mean square of residuals, on held-out visits where there are any [µm]; see `unit`"""

    after_rms_um: float | None
    """The same with the effects that were found [µm]; see `unit`"""

    found: tuple[str, ...]
    """What was found, one sentence each"""


@dataclass(frozen=True, slots=True)
class FoundOn(Answer):
    """One machine on which an effect was found by its own analysis."""

    machine: str
    """The machine"""

    analysis: int
    """The analysis that found it"""

    effect: int
    """Which of its effects, from 0"""

    status: str
    """How sure its name is there: `confirmed`, `suspected` or `not-confirmable`"""

    helps: bool
    """Whether held-out visits of that machine show that it helps"""

    parameters: Parameters
    """Its parameters there; the unit ends each name"""

    standard_errors: Parameters
    """One standard deviation of each"""


@dataclass(frozen=True, slots=True)
class TriedOn(Answer):
    """One sister on which the effect was tried as it stands."""

    machine: str
    """The sister"""

    result: TriedEffect
    """The outcome"""


@dataclass(frozen=True, slots=True)
class SharedEffect(AnsweredClaim):
    """An effect, the machines on which it was found, and how it did on their sisters."""

    explanation: str
    """The effect as found on the machine from which it was tried on the others"""

    found_on: tuple[FoundOn, ...]
    """Machines whose own analysis found it; the first is the one from which it was tried"""

    tried_on: tuple[TriedOn, ...]
    """Sisters on which it was tried"""

    not_tried_on: Mapping[str, str]
    """Sisters on which it was not tried, with the reason"""

    summary: str
    """On how many machines it was found and tried, with the outcomes"""


@dataclass(frozen=True, slots=True)
class FleetJudgement(Answer):
    """What the analyses of a fleet say together."""

    summary: str
    """Two plain sentences"""

    machines: tuple[FleetMachine, ...]
    """Every machine; those that drift come first"""

    effects: tuple[SharedEffect, ...]
    """Effects, those found on most machines first"""

    tried_together: int
    """Number of trials; the thresholds rise with it"""


def trials(members: Sequence[Member]) -> list[Trial]:
    """List which effects are to be tried on which sisters.

    An effect that helps where it was found is tried on every sister whose own analysis did not
    find it and that has something to judge it by.
    """
    return [
        Trial(first.id, first.analysis or 0, place, other.id)
        for together in _claims(members).values()
        for first, place, effect in [together[0]]
        if is_tried(effect)
        for other in _sisters(members, first)
        if other.id not in {m.id for m, _, _ in together} and other.has_verifications
    ]


def judge_fleet(members: Sequence[Member], tried: Mapping[Trial, TriedEffect]) -> FleetJudgement:
    """Put together what analyses found, and what came of the trials."""
    machines = sorted(
        (_machine(members, member) for member in members), key=lambda m: (m.drifts is None,)
    )
    effects = [_shared(members, together, tried) for together in _claims(members).values()]
    effects.sort(key=lambda e: -len(e.found_on))
    return FleetJudgement(_summary(machines, effects), tuple(machines), tuple(effects), len(tried))


_Claim: TypeAlias = tuple[Member, int, FoundEffect]


def _claims(members: Sequence[Member]) -> Mapping[object, list[_Claim]]:
    """Put effects together that say the same of sisters, the surest first."""
    claims: dict[object, list[_Claim]] = defaultdict(list)
    for member in members:
        for place, effect in enumerate(member.result.effects if member.result else ()):
            claims[member.likeness, claim_of(effect.effect)].append((member, place, effect))
    for together in claims.values():
        together.sort(key=lambda f: (not f[2].helps, -(f[2].evidence.two_ln_bayes_factor or 0.0)))
    return claims


def is_tried(effect: FoundEffect) -> bool:
    """Whether an effect is a candidate for sisters of the machine on which it was found."""
    return effect.helps and kind_of(effect.kind).of_the_type


def _sisters(members: Iterable[Member], of: Member) -> list[Member]:
    return [m for m in members if m.likeness == of.likeness and m.id != of.id]


def _machine(members: Sequence[Member], member: Member) -> FleetMachine:
    result = member.result
    return FleetMachine(
        machine=member.id,
        name=member.name,
        sisters=tuple(m.id for m in _sisters(members, member)),
        watch=member.watch,
        drifts=_drifts(member),
        analysis=member.analysis,
        verdict=None if result is None else result.verdict,
        why_not=None if result is not None else member.why_not,
        unit=None if result is None else result.unit,
        before_rms_um=None if result is None else result.before.shown_rms,
        after_rms_um=None if result is None else result.after.shown_rms,
        found=() if result is None else tuple(effect.explanation for effect in result.effects),
    )


def _drifts(member: Member) -> str | None:
    """Say why a machine is no longer what its model says; None where nothing says so."""
    effects = member.result.effects if member.result else ()
    reasons = [effect.explanation for effect in effects if kind_of(effect.kind).of_time_alone]
    if member.watch == "beyond":
        reasons.insert(0, "the latest verifications exceed the limits of its watch")
    return "; ".join(reasons) or None


def _shared(
    members: Sequence[Member], together: Sequence[_Claim], tried: Mapping[Trial, TriedEffect]
) -> SharedEffect:
    first, place, effect = together[0]
    ids = {member.id for member, _, _ in together}
    others = [m for m in _sisters(members, first) if m.id not in ids]
    results = {m.id: tried.get(Trial(first.id, first.analysis or 0, place, m.id)) for m in others}
    tried_on = tuple(TriedOn(on, result) for on, result in results.items() if result is not None)
    not_tried = {m.id: _why_not_tried(effect, m) for m in others if results[m.id] is None}
    return SharedEffect(
        *claim_of(effect),
        explanation=explain(effect.effect),
        found_on=tuple(
            FoundOn(
                machine=member.id,
                analysis=member.analysis or 0,
                effect=number,
                status=their_effect.status,
                helps=their_effect.helps,
                parameters=their_effect.parameters,
                standard_errors=their_effect.standard_errors,
            )
            for member, number, their_effect in together
        ),
        tried_on=tried_on,
        not_tried_on=not_tried,
        summary=_summary_words(together, others, tried_on),
    )


def _why_not_tried(effect: FoundEffect, other: Member) -> str:
    if not other.has_verifications:
        return "nothing was measured there"
    if not kind_of(effect.kind).of_the_type:
        return "an effect of this kind is one machine's own history"
    if not effect.helps:
        return "it is not known to help where it was found"
    return "it could not be tried"


_WORDS: Final[Mapping[Literal["yes", "no", "cannot-be-told", "adopted"], str]] = {
    "yes": "yes",
    "no": "no",
    "cannot-be-told": "cannot be told",
    "adopted": "adopted already",
}


def _summary_words(
    together: Sequence[_Claim], others: Sequence[Member], tried_on: Sequence[TriedOn]
) -> str:
    """Write on how many it was found and tried, and with which answer."""
    of_all = len(together) + len(others)
    prevalence = f"found on {len(together)} of {of_all}"
    if of_all == 1:
        return "found on 1, which has no sisters"
    if not tried_on:
        return f"{prevalence}; tried on none of the others" if others else f"{prevalence} sisters"
    counts = Counter(trial.result.verdict for trial in tried_on)
    answers = ", ".join(f"{_WORDS[verdict]} on {n}" for verdict, n in counts.items())
    return f"{prevalence}, tried on {len(tried_on)} of the other {len(others)}: {answers}"


def _summary(machines: Sequence[FleetMachine], effects: Sequence[SharedEffect]) -> str:
    judged = sum(m.why_not is None for m in machines)
    drifting = [m.machine for m in machines if m.drifts is not None]
    several = sum(len(e.found_on) > 1 for e in effects)
    drift = f"{list_names(drifting)} drift" if len(drifting) != 1 else f"{drifting[0]} drifts"
    return (
        f"{counted(judged, 'machine')} of {len(machines)} judged; "
        f"{drift if drifting else 'there is no sign that any of them drifts'}. "
        f"{counted(len(effects), 'effect')} found, {several} of them on several sisters."
    )
