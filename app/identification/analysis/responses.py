"""Responses of components to many collinear drivers, offered where they help held-out set-ups.

A response is learnt from what the model leaves without any response, other adopted effects
included: one that was adopted before is replaced, not added to. It is offered where set-ups held
out gain by more than chance would, none of them gets markedly worse, and it leaves less than the
effects that the search has named on the component, which it then takes the place of.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from app.arrays import FloatArray, IntArray, rms
from app.effects.adopted.learnt_ranges import with_ranges
from app.effects.effect import Effect
from app.effects.kind import NotTested
from app.effects.kinds.response import (
    AFTER,
    BEFORE,
    OF_RECORDS,
    SET_UPS,
    WORST_AFTER,
    WORST_BEFORE,
    Response,
)
from app.effects.observations import POINT_CHANNELS
from app.effects.registry import explain, kind_of
from app.effects.term import Term
from app.errors import list_names
from app.geometry.components import COMPONENTS
from app.identification.analysis.finished_search import FinishedSearch
from app.identification.analysis.found_effect import Cause, Evidence, FoundEffect
from app.identification.analysis.response_causes import causes_of
from app.identification.analysis.response_judged import Judged, judge
from app.identification.analysis.response_records import JudgedRecords, judge_records
from app.identification.analysis.response_rows import (
    ResponseRows,
    courses,
    response_rows,
    unrecorded_states,
)
from app.identification.campaign import Campaign, residuals_of
from app.identification.residuals.residuals import Residuals
from app.search.findings import FoundTerm, Status
from app.search.search import Progress

FEWEST: Final = 8
"""So many set-ups with a course are needed."""

MOST_NAMED: Final = 3
"""So many set-ups are named in a sentence."""

NOT_HELD_OUT: Final = (
    "its component already has a response that was learnt from these same set-ups, so none of "
    "them is held out of what that response leaves"
)


NOT_RECORDED: Final = (
    "it is stated beside observations only: a response follows a state through the readings, from "
    "the start of each set-up, so this one takes no part in it"
)


@dataclass(frozen=True, eq=False)
class Offered:
    """A response that helps.

    Parameters
    ----------
    code
        The component.
    effect
        What adoption stores.
    judged
        How set-ups held out fared.
    causes
        What can be said of its causes.
    instead_of
        What the effects that were named on the component leave, from each set-up's zero; None
        where none was.
    instead_kinds
        Their kinds.
    """

    code: str
    effect: Effect
    judged: Judged
    causes: tuple[Cause, ...] = ()
    instead_of: float | None = None
    instead_kinds: tuple[str, ...] = ()

    @property
    def found(self) -> FoundEffect:
        """Describe it."""
        parts = [explain(self.effect)]
        few = isinstance(self.judged, JudgedRecords)
        if isinstance(self.judged, JudgedRecords) and self.judged.tied:
            parts.append(f"{list_names(self.judged.tied)} would explain it as well")
        if self.judged.care > 1.0:
            parts.append(
                "so that no set-up gets markedly worse, uncertainty is weighted "
                f"{self.judged.care:g} times in deciding how much to correct"
            )
        if self.judged.rows.maps and self.judged.spares_maps:
            parts.append(
                "where the response is not sure, the maps alone are used, or else a set-up "
                "would get worse"
            )
        if self.judged.is_worse_than_none.any():
            parts.append(self._worse_than_none)
        if self.instead_of is not None:
            parts.append(
                "it replaces the effects that were named there "
                f"({list_names(self.instead_kinds)}), which would leave {self.instead_of:.3g} "
                f"{self._symbol}"
            )
        return FoundEffect(
            effect=self.effect,
            before_rms=self.judged.before_rms,
            after_rms=self.judged.after_rms,
            unit=self._symbol,
            status=str(Status.SUSPECTED if few else Status.CONFIRMED),
            helps=True,
            why_not=None,
            is_proxy=False,
            doubts=(),
            evidence=Evidence(p_global=self.judged.chance),
            alternatives=(),
            explanation="; ".join(parts),
            strongest_visits=(),
            leverage=0.0,
            leverage_warning=None,
            measure_again=None,
            causes=self.causes,
        )

    @property
    def _worse_than_none(self) -> str:
        """Name the set-ups that are left worse than without any correction."""
        after = self.judged.each[1]
        said = [
            f"{one.label!r} {rms(raw):.3g} to {after[i]:.3g} {self._symbol}"
            for i, (one, raw) in enumerate(
                zip(self.judged.rows.set_ups, self.judged.uncompensated, strict=True)
            )
            if self.judged.is_worse_than_none[i]
        ]
        return (
            "worse than with no correction at all, not even the maps: "
            f"{list_names(said, MOST_NAMED)}"
        )

    @property
    def _symbol(self) -> str:
        return COMPONENTS[self.code].unit.symbol


@dataclass(frozen=True, eq=False)
class Responses:
    """What was looked for beside the search: responses that help, and why others are not there."""

    offered: tuple[Offered, ...] = ()
    not_testable: tuple[NotTested, ...] = ()


def find_responses(
    campaign: Campaign, progress: Progress | None = None, known: Residuals | None = None
) -> Responses:
    """Learn and judge a response of every component that was observed by itself.

    Parameters
    ----------
    campaign
        The campaign.
    progress
        Called with the share done and what is being done.
    known
        Its residuals by the temperatures that were read, where they have been computed.
    """
    plain = [e for e in campaign.effects if e.kind != Response.kind]
    residuals = known
    if residuals is None or len(plain) < len(campaign.effects):
        residuals = residuals_of(replace(campaign, effects=plain))
    offered, refused = [], []
    codes = [code for code in residuals.rows.channels if code not in POINT_CHANNELS]
    for i, code in enumerate(codes):
        if progress is not None:
            progress(i / len(codes), f"learning a response of {code}")
        found = _of_component(campaign, residuals, code)
        if isinstance(found, Offered):
            offered.append(found)
        elif found:
            refused.append(NotTested(Response.kind, code, found))
    if any(courses(residuals.rows, code) >= FEWEST for code in codes):
        refused += [
            NotTested(Response.kind, name, NOT_RECORDED)
            for name in unrecorded_states(residuals.projection.conditions)
        ]
    return Responses(tuple(offered), tuple(refused))


def _of_component(campaign: Campaign, residuals: Residuals, code: str) -> Offered | str:
    """Find the response of one component, or say why there is none."""
    own = residuals.rows.of_channel(code)
    if not residuals.rows.times_s[own].size:
        return "none of its observations can be used"
    before = [e for e in campaign.effects if e.kind == Response.kind and code in e.components]
    if any(_has_learnt_from(effect, residuals.rows.times_s[own]) for effect in before):
        return ""
    if np.ptp(np.nan_to_num(residuals.projection.view(code).places.positions_mm)) > 0.0:
        return "needs observations at one position over hours in which temperatures change"
    count = courses(residuals.rows, code)
    if count >= FEWEST:
        rows = response_rows(residuals, code)
        count = len(rows.set_ups)
    if count < FEWEST:
        few = judge_records(campaign, residuals, code)
        if isinstance(few, JudgedRecords) and not few.why_not:
            return Offered(code, _effect(few.rows, few, residuals), few)
        why_not = few.why_not if isinstance(few, JudgedRecords) else few
        return (
            f"needs at least {FEWEST} set-ups that each cover an hour with sensor readings, got "
            f"{count}; a second sensor alone, which fewer show: {why_not}"
        )
    judged = judge(rows)
    if judged.why_not:
        return "" if judged.is_by_chance else judged.why_not
    rows = judged.rows
    return Offered(code, _effect(rows, judged, residuals), judged, causes_of(rows, judged.average))


def _has_learnt_from(effect: Effect, times_s: FloatArray) -> bool:
    """Whether a response has seen all observations already."""
    valid = effect.valid
    return valid is not None and bool(
        valid.from_s <= times_s.min() + 1.0 and times_s.max() - 1.0 <= valid.to_s
    )


def _effect(rows: ResponseRows, judged: Judged, residuals: Residuals) -> Effect:
    driver = rows.driver(
        judged.average,
        rows.set_ups,
        judged.doubt,
        judged.counted,
        spares_maps=judged.spares_maps,
    )
    unit = COMPONENTS[rows.code].unit
    before, after = judged.each
    worst = int(np.argmax(after - before))
    few = isinstance(judged, JudgedRecords)
    sensors = dict.fromkeys(c.name for c in rows.columns if not c.is_of_state)
    effect = Effect(
        kind=Response.kind,
        variant=OF_RECORDS if few else "",
        components=(rows.code,),
        sensors=(*sensors, *([rows.own_sensor] if few else [])),
        states=tuple(dict.fromkeys(c.name for c in rows.columns if c.is_of_state)),
        parameters={
            f"{BEFORE}_{unit}": judged.before_rms,
            f"{AFTER}_{unit}": judged.after_rms,
            f"{WORST_BEFORE}_{unit}": float(before[worst]),
            f"{WORST_AFTER}_{unit}": float(after[worst]),
            SET_UPS: float(len(rows.set_ups)),
        },
        terms=(Term(rows.code, driver),),
    )
    use = np.zeros(len(residuals.rows), dtype=np.bool_)
    use[residuals.rows.of_channel(rows.code)] = True
    return with_ranges(effect, residuals.projection, use)


def beside_search(
    found: FinishedSearch, responses: Responses, known: Sequence[Effect]
) -> tuple[FinishedSearch, Responses]:
    """Set responses beside what the search found: of both on a component, the one that leaves less.

    Parameters
    ----------
    found
        The finished search.
    responses
        What was found beside it.
    known
        The effects of the model that was analysed.

    Returns
    -------
    FinishedSearch
        Without the effects whose place responses take, and with what set-ups held out say of
        these.
    Responses
        Those that are left. A component that shares an effect with others has none unless they
        all have one: it is learnt of what that leaves when it has been adopted.
    """
    found = _suspecting(found, known)
    named = {o.code: [t.key for t in _named(found, o.code)] for o in responses.offered}
    kept = []
    for offered, left in that_leave_less(found, responses.offered):
        keys = named[offered.code]
        found = _taking_place(found, offered, keys)
        kinds = tuple(dict.fromkeys(found.hypotheses[key].kind for key in keys))
        kept.append(replace(offered, instead_of=left, instead_kinds=kinds))
    return found, replace(responses, offered=tuple(kept))


def that_leave_less(
    found: FinishedSearch, offered: Sequence[Offered]
) -> list[tuple[Offered, float | None]]:
    """Choose the responses that take the place of all that is named on their components.

    What acts on several components goes only if each of these has a response that leaves less.
    A mistake in the data that is confirmed stays, for a response would have learnt it; one
    that is suspected, or beside which something unexplained is left, stands for something else
    where responses leave less than it does.

    Returns
    -------
    list of (Offered, float or None)
        Each with what the effects leave whose place it takes, from each set-up's zero.
    """
    left = {one.code: _left_by_named(found, one.code) for one in offered}
    less = {one.code for one in offered if _leaves_less(one, left[one.code])}
    while True:
        kept = {code for code in less if all(_goes(found, t, less) for t in _named(found, code))}
        if kept == less:
            return [(one, left[one.code]) for one in offered if one.code in kept]
        less = kept


def _leaves_less(offered: Offered, left: float | None) -> bool:
    return left is None or offered.judged.after_rms < left


def _named(found: FinishedSearch, code: str) -> list[FoundTerm]:
    """List what the search has named on a component."""
    return [t for t in found.findings.terms if code in found.hypotheses[t.key].components]


def _goes(found: FinishedSearch, term: FoundTerm, codes: set[str]) -> bool:
    """Whether responses of some components may take the place of an effect."""
    hypothesis = found.hypotheses[term.key]
    is_sure = term.status is Status.CONFIRMED and not found.is_unexplained_at(term.channels)
    if is_sure and kind_of(hypothesis.kind).not_adopted:
        return False
    return codes >= set(hypothesis.components)


def not_beside(described: Iterable[FoundEffect], known: Sequence[Effect]) -> list[FoundEffect]:
    """Say of effects on a component with an adopted response that nobody can say they help.

    Parameters
    ----------
    described
        What the search found.
    known
        The effects of the model that was analysed.
    """
    learnt = {code for e in known if e.kind == Response.kind for code in e.components}
    return [
        replace(one, helps=False, why_not=NOT_HELD_OUT)
        if learnt.intersection(one.effect.components)
        else one
        for one in described
    ]


def _suspecting(found: FinishedSearch, known: Sequence[Effect]) -> FinishedSearch:
    """Confirm nothing on a component whose response has learnt from the same set-ups.

    No set-up is held out of that: what is left of all of them is less than it will be.
    """
    learnt = {code for e in known if e.kind == Response.kind for code in e.components}
    terms = tuple(
        replace(term, status=Status.SUSPECTED)
        if term.status is Status.CONFIRMED
        and learnt.intersection(found.hypotheses[term.key].components)
        else term
        for term in found.findings.terms
    )
    return replace(found, findings=replace(found.findings, terms=terms))


def _taking_place(found: FinishedSearch, offered: Offered, keys: Sequence[str]) -> FinishedSearch:
    """Leave effects out, and put what set-ups held out say of a response in their place."""
    findings = found.findings
    own = found.residuals.rows.of_channel(offered.code)
    rows, left = _held_out(found.residuals, offered)
    said = []
    for foretold in (findings.predicted, findings.adopted):
        anew = foretold.copy()
        anew[own] = np.nan
        anew[rows] = np.where(np.isfinite(foretold[rows]), found.rows.values[rows] - left, np.nan)
        said.append(anew)
    terms = tuple(term for term in findings.terms if term.key not in keys)
    return replace(
        found, findings=replace(findings, terms=terms, predicted=said[0], adopted=said[1])
    )


def explained_by(found: FinishedSearch, offered: Offered, known: Iterable[Effect]) -> FloatArray:
    """Say what a response adds to each row, beyond one that it takes the place of, shape (n,).

    Parameters
    ----------
    found
        The finished search.
    offered
        The response.
    known
        The effects of the model that was analysed.
    """
    before = [e for e in known if e.kind == Response.kind and offered.code in e.components]
    total = found.explained(offered.effect)
    for effect in before:
        total = total - found.explained(effect)
    return total


def _left_by_named(found: FinishedSearch, code: str) -> float | None:
    """Say what the search's effects leave of a component held out, from each set-up's zero.

    None where it has named none, or nothing was held out.
    """
    if not _named(found, code):
        return None
    rows, left = found.residuals.rows, found.rows.values - found.findings.adopted
    own = rows.of_channel(code)
    parts = [_from_zero(rows.times_s[part], left[part]) for part in _by_visit(rows.visit, own)]
    known = np.concatenate([part[np.isfinite(part)] for part in parts])
    return rms(known) if known.size else None


def _held_out(residuals: Residuals, offered: Offered) -> tuple[IntArray, FloatArray]:
    """Give the rows of a response's set-ups, and what the others' response leaves of each."""
    own = residuals.rows.of_channel(offered.code)
    at = {float(t): int(row) for t, row in zip(residuals.rows.times_s[own], own, strict=True)}
    found: list[int] = []
    left: list[float] = []
    for one, after in zip(offered.judged.rows.set_ups, offered.judged.after, strict=True):
        whole = np.concatenate([[0.0], after]) if one.is_zeroed else after
        for t, value in zip(one.times_s.tolist(), whole.tolist(), strict=True):
            if t in at:
                found.append(at[t])
                left.append(value)
    return np.array(found, dtype=np.intp), np.array(left)


def _by_visit(visit: IntArray, own: IntArray) -> Iterable[IntArray]:
    return [own[visit[own] == which] for which in np.unique(visit[own])]


def _from_zero(times_s: FloatArray, values: FloatArray) -> FloatArray:
    first = int(np.argmin(times_s))
    found: FloatArray = values - values[first] if np.isfinite(values[first]) else values
    return found
