"""Responses of components to many collinear drivers, offered where they help held-out set-ups.

A response is learnt from what the model leaves without any response, other adopted effects
included: one that was adopted before is replaced, not added to. It is offered where set-ups held
out gain by more than chance would, none of them gets markedly worse, and it leaves less than the
effects of the component that would otherwise be adopted. Then it takes the place of all that the
search has named there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
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
    SET_UPS,
    WORST_AFTER,
    WORST_BEFORE,
    Response,
)
from app.effects.observations import POINT_CHANNELS
from app.effects.registry import explain, kind_of
from app.effects.response_driver import Responding
from app.effects.term import Term
from app.errors import list_names
from app.geometry.components import COMPONENTS
from app.identification.analysis.decide import Decision, decide
from app.identification.analysis.finished_search import FinishedSearch
from app.identification.analysis.found_effect import Evidence, FoundEffect
from app.identification.analysis.response_judged import Judged, judge
from app.identification.analysis.response_rows import (
    FEWEST,
    SHORTEST_MIN,
    response_rows,
    unrecorded_states,
)
from app.identification.campaign import Campaign, residuals_of
from app.identification.residuals.residuals import Residuals
from app.search.findings import FoundTerm, Status
from app.search.search import Progress

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
    instead_of
        What the effects that would be adopted on the component leave, from each set-up's zero; None
        where none would be.
    instead_kinds
        The kinds of all that are named there.
    """

    code: str
    effect: Effect
    judged: Judged
    instead_of: float | None = None
    instead_kinds: tuple[str, ...] = ()

    @property
    def found(self) -> FoundEffect:
        """Describe it."""
        parts = [explain(self.effect)]
        if self.instead_kinds:
            parts.append(f"it takes the place of what was named there ({self._instead})")
        return FoundEffect(
            effect=self.effect,
            before_rms=self.judged.before_rms,
            after_rms=self.judged.after_rms,
            unit=COMPONENTS[self.code].unit.symbol,
            status=str(Status.CONFIRMED if self.judged.is_confirmed else Status.SUSPECTED),
            helps=True,
            evidence=Evidence(p_global=self.judged.chance),
            explanation="; ".join(parts),
            causes=self.judged.causes,
        )

    @property
    def _instead(self) -> str:
        """Name what it takes the place of, with what that would leave."""
        kinds = list_names(self.instead_kinds)
        if self.instead_of is None:
            return f"{kinds}, not to be adopted"
        return (
            f"{kinds}, which would leave {self.instead_of:.3g} {COMPONENTS[self.code].unit.symbol}"
        )


@dataclass(frozen=True, eq=False)
class Responses:
    """What was looked for beside the search: responses that help, and why others are not there."""

    offered: tuple[Offered, ...] = ()
    not_testable: tuple[NotTested, ...] = ()


def find_responses(
    campaign: Campaign, progress: Progress | None = None, shared: Residuals | None = None
) -> Responses:
    """Learn and judge a response of every component that was observed by itself.

    Parameters
    ----------
    progress
        Called with the share done and what is being done.
    shared
        Its residuals by the temperatures that were read, where they have been computed.
    """
    plain = [e for e in campaign.effects if e.kind != Response.kind]
    residuals = shared
    if residuals is None or len(plain) < len(campaign.effects):
        residuals = residuals_of(replace(campaign, effects=plain))
    offered, refused = [], []
    codes = [code for code in residuals.rows.channels if code not in POINT_CHANNELS]
    for i, code in enumerate(codes):
        if progress is not None:
            progress(i / len(codes), f"learning a response of {code}")
        outcome = _of_component(campaign, residuals, code)
        if isinstance(outcome, Offered):
            offered.append(outcome)
        elif outcome:
            refused.append(NotTested(Response.kind, code, outcome))
    if offered:
        refused += [
            NotTested(Response.kind, name, NOT_RECORDED)
            for name in unrecorded_states(residuals.projection.conditions)
        ]
    return Responses(tuple(offered), tuple(refused))


def _of_component(campaign: Campaign, residuals: Residuals, code: str) -> Offered | str:
    """Find the response of one component, or say why there is none."""
    rows_of_code = residuals.rows.of_channel(code)
    if not residuals.rows.times_s[rows_of_code].size:
        return "none of its observations can be used"
    before = [e for e in campaign.effects if e.kind == Response.kind and code in e.components]
    if any(_has_learnt_from(effect, residuals.rows.times_s[rows_of_code]) for effect in before):
        return ""
    if np.ptp(np.nan_to_num(residuals.projection.view(code).places.positions_mm)) > 0.0:
        return "needs observations at one position over hours in which temperatures change"
    rows = response_rows(residuals, code)
    if len(rows.set_ups) < FEWEST:
        return (
            f"needs at least {FEWEST} set-ups that each cover {SHORTEST_MIN:.0f} min with sensor "
            "readings, or a record of that length with the datum `absolute`, got "
            f"{len(rows.set_ups)}"
        )
    judged = judge(rows)
    return judged.why_not or Offered(code, _effect(judged, residuals), judged)


def _has_learnt_from(effect: Effect, times_s: FloatArray) -> bool:
    """Whether a response, as it is learnt now, has seen all observations already."""
    valid = effect.valid
    is_of_now = any(isinstance(term.driver, Responding) for term in effect.terms)
    return (is_of_now and valid is not None) and bool(
        valid.from_s <= times_s.min() + 1.0 and times_s.max() - 1.0 <= valid.to_s
    )


def _effect(judged: Judged, residuals: Residuals) -> Effect:
    rows = judged.rows
    unit = COMPONENTS[rows.code].unit
    _, before, after = judged.each
    effect = Effect(
        kind=Response.kind,
        components=(rows.code,),
        sensors=tuple(dict.fromkeys(c.name for c in rows.columns if c.name and not c.is_of_state)),
        states=tuple(dict.fromkeys(c.name for c in rows.columns if c.is_of_state)),
        parameters={
            f"{BEFORE}_{unit}": judged.before_rms,
            f"{AFTER}_{unit}": judged.after_rms,
            f"{WORST_BEFORE}_{unit}": float(before[judged.worst]),
            f"{WORST_AFTER}_{unit}": float(after[judged.worst]),
            SET_UPS: float(len(rows.set_ups)),
        },
        terms=(Term(rows.code, rows.driver(judged.fitted)),),
    )
    use = np.zeros(len(residuals.rows), dtype=np.bool_)
    use[residuals.rows.of_channel(rows.code)] = True
    return with_ranges(effect, residuals.projection, use)


def beside_search(
    finished: FinishedSearch, responses: Responses, adopted: Sequence[Effect]
) -> tuple[FinishedSearch, Responses]:
    """Set responses beside what the search found: of both on a component, the one that leaves less.

    Returns
    -------
    FinishedSearch
        Without the effects whose place responses take, and with what set-ups held out say of
        these.
    Responses
        Those that are left. A component that shares an effect with others has none unless they
        all have one: it is learnt of what that leaves when it has been adopted.
    """
    finished = _suspecting(finished, adopted)
    judged = decide(finished, finished.effects()) if responses.offered else Decision([])
    named = {o.code: [t.key for t in _named(finished, o.code)] for o in responses.offered}
    residuals_by_code = {
        o.code: _left_by_adopted(finished, judged, o.code) for o in responses.offered
    }
    chosen = that_leave_less(finished, responses.offered, residuals_by_code)
    refused = [
        NotTested(
            Response.kind,
            response.code,
            _why_not_instead(response, residuals_by_code[response.code]),
        )
        for response in responses.offered
        if response not in chosen
    ]
    accepted = []
    for offered in chosen:
        keys = named[offered.code]
        kinds = tuple(dict.fromkeys(finished.hypotheses[key].kind for key in keys))
        finished = _taking_place(finished, offered, keys)
        accepted.append(
            replace(offered, instead_of=residuals_by_code[offered.code], instead_kinds=kinds)
        )
    return finished, Responses(tuple(accepted), (*responses.not_testable, *refused))


def that_leave_less(
    finished: FinishedSearch,
    offered: Sequence[Offered],
    residuals_by_code: Mapping[str, float | None],
) -> list[Offered]:
    """Choose the responses that take the place of all that is named on their components.

    What acts on several components goes only if each of these has a response that leaves less.
    A mistake in the data that is confirmed stays, for a response would have learnt it; one
    that is suspected, or beside which something unexplained is left, stands for something else
    where responses leave less than it does.

    Parameters
    ----------
    residuals_by_code
        For each component what its effects leave that would be adopted; None: there are none.
    """
    less = {
        response.code
        for response in offered
        if _leaves_less(response, residuals_by_code[response.code])
    }
    while True:
        leaving_less = {
            code for code in less if all(_goes(finished, t, less) for t in _named(finished, code))
        }
        if leaving_less == less:
            return [response for response in offered if response.code in leaving_less]
        less = leaving_less


def _why_not_instead(offered: Offered, residual: float | None) -> str:
    """Say what held-out set-ups would be left with, and why a response is not adopted."""
    judged, symbol = offered.judged, COMPONENTS[offered.code].unit.symbol
    goes = (
        f"held-out set-ups would go from {judged.before_rms:.3g} to {judged.after_rms:.3g} {symbol}"
    )
    if residual is not None and not _leaves_less(offered, residual):
        return f"{goes}, but the effects named there leave {residual:.3g} {symbol}"
    return f"{goes}, but what else is named there is to be put right first, or acts elsewhere too"


def _leaves_less(offered: Offered, residual: float | None) -> bool:
    return residual is None or offered.judged.after_rms < residual


def _named(finished: FinishedSearch, code: str) -> list[FoundTerm]:
    """List what the search has named on a component."""
    return [t for t in finished.findings.terms if code in finished.hypotheses[t.key].components]


def _goes(finished: FinishedSearch, term: FoundTerm, codes: set[str]) -> bool:
    """Whether responses of some components may take the place of an effect."""
    hypothesis = finished.hypotheses[term.key]
    is_sure = term.status is Status.CONFIRMED and not finished.is_unexplained_at(term.channels)
    if is_sure and kind_of(hypothesis.kind).not_adopted:
        return False
    return codes >= set(hypothesis.components)


def not_beside(described: Iterable[FoundEffect], adopted: Sequence[Effect]) -> list[FoundEffect]:
    """Say of effects on a component with an adopted response that nobody can say they help."""
    learnt = {code for e in adopted if e.kind == Response.kind for code in e.components}
    return [
        replace(description, helps=False, why_not=NOT_HELD_OUT)
        if learnt.intersection(description.effect.components)
        else description
        for description in described
    ]


def _suspecting(finished: FinishedSearch, adopted: Sequence[Effect]) -> FinishedSearch:
    """Confirm nothing on a component whose response has learnt from the same set-ups.

    No set-up is held out of that: what is left of all of them is less than it will be.
    """
    learnt = {code for e in adopted if e.kind == Response.kind for code in e.components}
    terms = tuple(
        replace(term, status=Status.SUSPECTED)
        if term.status is Status.CONFIRMED
        and learnt.intersection(finished.hypotheses[term.key].components)
        else term
        for term in finished.findings.terms
    )
    return replace(finished, findings=replace(finished.findings, terms=terms))


def _taking_place(
    finished: FinishedSearch, offered: Offered, keys: Sequence[str]
) -> FinishedSearch:
    """Leave effects out, and put what set-ups held out say of a response in their place."""
    findings = finished.findings
    rows_of_code = finished.residuals.rows.of_channel(offered.code)
    rows, residuals = _held_out(finished.residuals, offered)
    predictions = []
    for foretold in (findings.predicted, findings.adopted):
        anew = foretold.copy()
        anew[rows_of_code] = np.nan
        anew[rows] = np.where(
            np.isfinite(foretold[rows]), finished.rows.values[rows] - residuals, np.nan
        )
        predictions.append(anew)
    stays = np.array([term.key not in keys for term in findings.terms], dtype=np.bool_)
    terms = tuple(term for term in findings.terms if term.key not in keys)
    apart = None if findings.apart is None else findings.apart[stays]
    return replace(
        finished,
        findings=replace(
            findings, terms=terms, apart=apart, predicted=predictions[0], adopted=predictions[1]
        ),
    )


def explained_by(
    finished: FinishedSearch, offered: Offered, adopted: Iterable[Effect]
) -> FloatArray:
    """Say what a response adds to each row, beyond one that it takes the place of, shape (n,)."""
    before = [e for e in adopted if e.kind == Response.kind and offered.code in e.components]
    total = finished.explained(offered.effect)
    for effect in before:
        total = total - finished.explained(effect)
    return total


def _left_by_adopted(finished: FinishedSearch, judged: Decision, code: str) -> float | None:
    """Say what effects that would be adopted leave of a component held out, from each zero.

    None where there are none, or nothing was held out.
    """
    pairs = list(zip(finished.effects(), judged.helps, strict=True))
    if not any(verdict.helps for effect, verdict in pairs if code in effect.components):
        return None
    refused = [finished.foretold(i) for i, (_, verdict) in enumerate(pairs) if not verdict.helps]
    rows = finished.residuals.rows
    residuals = (
        finished.rows.values - finished.findings.adopted + sum(refused, np.zeros(len(finished.use)))
    )
    rows_of_code = rows.of_channel(code)
    parts = [
        _from_zero(rows.times_s[part], residuals[part])
        for part in _by_visit(rows.visit, rows_of_code)
    ]
    finite = np.concatenate([part[np.isfinite(part)] for part in parts])
    return rms(finite) if finite.size else None


def _held_out(residuals: Residuals, offered: Offered) -> tuple[IntArray, FloatArray]:
    """Give the rows of a response's set-ups, and what the others' response leaves of each."""
    rows_of_code = residuals.rows.of_channel(offered.code)
    at = {
        float(t): int(row)
        for t, row in zip(residuals.rows.times_s[rows_of_code], rows_of_code, strict=True)
    }
    numbers: list[int] = []
    remaining: list[float] = []
    for set_up, after in zip(offered.judged.rows.set_ups, offered.judged.after, strict=True):
        whole = np.concatenate([[0.0], after]) if set_up.is_zeroed else after
        for t, value in zip(set_up.times_s.tolist(), whole.tolist(), strict=True):
            if t in at:
                numbers.append(at[t])
                remaining.append(value)
    return np.array(numbers, dtype=np.intp), np.array(remaining)


def _by_visit(visit: IntArray, rows: IntArray) -> Iterable[IntArray]:
    return [rows[visit[rows] == which] for which in np.unique(visit[rows])]


def _from_zero(times_s: FloatArray, values: FloatArray) -> FloatArray:
    first = int(np.argmin(times_s))
    shifted: FloatArray = values - values[first] if np.isfinite(values[first]) else values
    return shifted
