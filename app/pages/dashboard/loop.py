"""The page of the loop: what checks showed, what an analysis found, and the decision."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from itertools import groupby
from statistics import median
from typing import Any, Final

from app.effects.observations import Verification
from app.effects.registry import KINDS, kind_of
from app.errors import capitalised
from app.geometry.components import COMPONENTS, Kind
from app.identification.analysis.analysis import Analysis, TriedAssignment
from app.identification.analysis.figures import ComponentFigures
from app.identification.analysis.found_effect import FoundEffect
from app.identification.analysis.plots import EffectCurve, VisitMeans
from app.pages.dashboard.charts import round_up
from app.pages.dashboard.loop_charts import Marks, residual_chart
from app.pages.dashboard.numbers import clock, marked
from app.pages.environment import render_live, render_machine
from app.pages.reader import zone_name
from app.pages.report_parts.assignment_words import proposal_words, staying_words
from app.pages.report_parts.component_names import component_name
from app.pages.report_parts.drawing import TIME, largest
from app.pages.report_parts.effect_names import (
    MARKS,
    VERDICTS,
    adoption_text,
    explanation_name,
    kind_name,
    parameter_name,
    parameter_text,
    rival_name,
    status_words,
    untested_together,
)
from app.pages.report_parts.smallest_seen import size_range, units_of
from app.pages.report_parts.words import chance_text, decimals_for, figure_text, sentence
from app.pages.what_was_read import read_of_verification
from app.pages.wording import _, counted, listed, message, said, said_plainly
from app.services.loop import UNFINISHED, LaterVisits, LeftOfCheck, LoopView
from app.storage.records import AnalysisStatus, StoredAnalysis, StoredVerification
from app.units import Unit

MOST_RIVALS: Final = 6
VERY_STRONG: Final = 10.0
"""2 ln B, after Kass and Raftery (1995)."""

RIGID: Final = [
    code
    for code, one in COMPONENTS.items()
    if one.kind in (Kind.LINEAR, Kind.STRAIGHTNESS, Kind.ANGULAR, Kind.SQUARENESS)
]
"""What is measured along a rigid machine's linear axes; others can be typed in as well."""

_STATUSES: Final = {
    "confirmed": message("Confirmed"),
    "suspected": message("Suspected"),
    "not-confirmable": message("Not confirmable"),
}
JOBS: Final = {
    AnalysisStatus.QUEUED: message("queued"),
    AnalysisStatus.RUNNING: message("running"),
    AnalysisStatus.DONE: message("done"),
    AnalysisStatus.FAILED: message("failed"),
    AnalysisStatus.CANCELLED: message("cancelled"),
}
_JUDGED: Final = {
    "within": message("no change proved"),
    "beyond": message("change proved"),
    "not-judged": message("not judged"),
}


def loop_page(view: LoopView, now: datetime, methods: Mapping[str, str]) -> str:
    """Write the page of the loop."""
    analysis, result = view.chosen, view.result
    labels = {v.id: v.label for v in view.verifications}
    return render_machine(
        "loop",
        "/loop",
        view.machine_id,
        view.machine_name,
        now,
        view=view,
        analysis=analysis,
        analysed=_analysed(analysis, labels),
        is_running=analysis is not None and analysis.status in UNFINISHED,
        steps=_steps(view),
        checks=[_check(v, analysis, now) for v in reversed(view.verifications)],
        jobs=[_job(one, now) for one in reversed(view.analyses)],
        later="" if view.later is None else later_words(view.later),
        kinds=[(kind, kind_name(kind)) for kind in sorted(KINDS)],
        codes=RIGID,
        methods=methods,
        result=result,
        **({} if result is None else _result(view, result)),
    )


def left_of_check(found: LeftOfCheck) -> str:
    """Write what the active version leaves of a check, as a part of the page of the loop."""
    return render_live("dashboard/left_of_check.html", found=found)


def check_preview(found: Verification, name: str, remarks: Sequence[str]) -> str:
    """Write what was read of a check, before it is stored."""
    return render_live(
        "dashboard/check_preview.html",
        read=read_of_verification(found),
        name=name,
        remarks=remarks,
    )


def later_words(later: LaterVisits) -> str:
    """Say what visits after the analysed ones show of what was adopted.

    >>> later_words(LaterVisits([]))
    'No later visits yet: store a check to see what it is worth.'
    """
    if not later.verification_ids:
        return _("No later visits yet: store a check to see what it is worth.")
    if later.before is None or later.after is None:
        return counted(
            len(later.verification_ids),
            "%(count)s later check: nothing can be said, %(why)s.",
            "%(count)s later checks: nothing can be said, %(why)s.",
            why=said_plainly(later.why_not or ""),
        )
    decimals = decimals_for(later.before.repeatability)
    before, after = (figure_text(s.rms, decimals) for s in (later.before, later.after))
    visits = counted(later.visits, "%(count)s later visit", "%(count)s later visits")
    return f"{visits}: {before} → {after} {later.before.unit}."


def _steps(view: LoopView) -> list[dict[str, Any]]:
    """Say where we are: checks, analysis, decide, later visits."""
    one, later = view.chosen, view.later
    observations = sum(v.count for v in view.verifications)
    checks = ", ".join(
        (
            counted(len(view.verifications), "%(count)s check", "%(count)s checks"),
            counted(observations, "%(count)s observation", "%(count)s observations"),
        )
    )
    decided = _("nothing yet")
    at = 1 if view.verifications else 0
    if one is not None and one.status is AnalysisStatus.DONE:
        at, decided = 2, _("to be decided")
        if view.result is not None and not view.result.effects and not view.result.is_refit_due:
            decided = _("nothing to adopt")
    if later is not None and one is not None:
        at, decided = 3, _("adopted as v%(version)s", version=one.adopted_version)
        if view.active_version == one.task.model_version:
            decided += _(", taken back")
    came = _("none yet") if later is None or not later.verification_ids else ""
    return [
        {"title": title, "text": text, "is_current": place == at}
        for place, (title, text) in enumerate(
            (
                (_("1 Checks"), checks if view.verifications else _("none yet")),
                (
                    _("2 Analysis %(number)s", number=one.id if one else ""),
                    _(JOBS[one.status]) if one else _("none"),
                ),
                (_("3 Decide"), decided),
                (
                    _("4 Later visits"),
                    came
                    or counted(
                        len(later.verification_ids) if later else 0,
                        "%(count)s check",
                        "%(count)s checks",
                    ),
                ),
            )
        )
    ]


def _analysed(one: StoredAnalysis | None, labels: dict[int, str]) -> str:
    """Name what an analysis is of."""
    if one is None:
        return ""
    names = [
        labels.get(i, _("number %(number)s, deleted", number=i)) for i in one.task.verification_ids
    ]
    return listed(names, 4)


def _check(one: StoredVerification, chosen: StoredAnalysis | None, now: datetime) -> dict[str, Any]:
    # What the shown analysis left out stays out; what came after it was asked for is new to it.
    return {
        "stored": one,
        "when": clock(one.first_at, now),
        "what": listed(one.components, 6),
        "judged": "–" if one.judgement is None else _(_JUDGED[one.judgement.status]),
        "why": "" if one.judgement is None else one.judgement.summary,
        "is_ticked": chosen is None
        or one.id in chosen.task.verification_ids
        or one.stored_at > chosen.created_at,
    }


def _job(one: StoredAnalysis, now: datetime) -> dict[str, Any]:
    adopted = "–" if one.adopted_version is None else f"v{one.adopted_version}"
    return {
        "stored": one,
        "when": clock(one.created_at, now),
        "adopted": adopted,
        "state": _(JOBS[one.status]),
    }


def _result(view: LoopView, result: Analysis) -> dict[str, Any]:
    analysis = view.chosen
    assert analysis is not None
    decimals = decimals_for(result.noise)
    adoptable = [e for e in result.effects if not kind_of(e.kind).not_adopted]
    is_decided = analysis.adopted_version is not None
    return {
        "headline": _headline(result),
        "found": _found_sentence(result, decimals),
        "verdict_words": VERDICTS[result.verdict],
        "effects": [_effect(number, one, result) for number, one in enumerate(result.effects)],
        "can_adopt": not is_decided and bool(adoptable or result.is_refit_due),
        "is_adopted": is_decided,
        "adopted_words": _adopted_words(view),
        "is_current": view.active_version == analysis.task.model_version,
        "can_go_back": is_decided
        and view.active_version not in (None, analysis.task.model_version),
        "by_unit": list(_by_unit(result.components)),
        "all_held_out": all(c.is_held_out for c in result.components),
        "visits": _visit_chart(result),
        "proposals": [_proposal(one) for one in result.proposals],
        "staying": staying_words(result.assignments),
        "untested": untested_together(result.not_testable),
        "seen": _seen(result, decimals),
        "seen_units": units_of(result.detectable),
        "decimals": decimals,
    }


def _adopted_words(view: LoopView) -> str:
    """Say which version was made of the analysis, and whether tables come from it."""
    analysis, active = view.chosen, view.active_version
    assert analysis is not None
    made = analysis.adopted_version
    if active == made:
        return _("Adopted as v%(version)s.", version=made)
    if active == analysis.task.model_version:
        return _(
            "Adopted as v%(version)s, and taken back: v%(active)s is active.",
            version=made,
            active=active,
        )
    return _("Adopted as v%(version)s; now v%(active)s is active.", version=made, active=active)


def _headline(result: Analysis) -> str:
    """The answer: the first effect in its own sentence, or what the verdict is."""
    first = next(iter(result.effects), None)
    if first is None:
        return f"{_(VERDICTS[result.verdict])}."
    more = len(result.effects) - 1
    if not more:
        return said(sentence(f"{first.explanation}."))
    return counted(
        more,
        "%(effect)s, and %(count)s more effect.",
        "%(effect)s, and %(count)s more effects.",
        effect=said_plainly(sentence(first.explanation)),
    )


def _found_sentence(result: Analysis, decimals: int) -> list[str]:
    """Before, after, floor; where nothing was found, the analysis' own summary."""
    if not result.effects:
        return [said(sentence(result.summary))]
    before, after = (figure_text(f.shown_rms, decimals) for f in (result.before, result.after))
    unit = result.unit
    if result.before.holdout_rms is not None:
        where = _("On visits that took no part in finding it:")
    else:
        where = _("Over all visits, none of which could be held out:")
    if len(result.effects) == 1:
        change = _(
            "the residuals go from %(before)s to %(after)s %(unit)s RMS.",
            before=before,
            after=after,
            unit=unit,
        )
    else:
        change = _(
            "the residuals go from %(before)s to %(after)s %(unit)s RMS with all effects.",
            before=before,
            after=after,
            unit=unit,
        )
    found = [f"{where} {change}"]
    if result.floor is not None:
        floor = figure_text(result.floor, decimals)
        found.append(
            _(
                "Repeatability and set-ups alone would leave %(floor)s %(unit)s.",
                floor=floor,
                unit=unit,
            )
        )
    else:
        why = said_plainly(result.floor_unknown or "") or _("it was not measured")
        found.append(_("The floor is unknown: %(why)s.", why=why))
    if result.verdict == "unexplained":
        found.append(_("Something remains that no effect explains."))
    return found


def _effect(number: int, one: FoundEffect, result: Analysis) -> dict[str, Any]:
    evidence = one.evidence
    facts = []
    if evidence.seen_in_readings:
        facts.append(_("in the readings: %(what)s", what=said_plainly(evidence.seen_in_readings)))
    else:
        facts.append(_slope_words(one))
        if evidence.p_global is not None:
            facts.append(
                _("by chance: %(chance)s", chance=said_plainly(chance_text(evidence.p_global)))
            )
    curves = result.plots.effects
    curve = curves[number] if number < len(curves) else None
    warnings = [w for w in (one.doubt, one.leverage_warning, one.measure_again) if w]
    if one.is_proxy:
        warnings.append(
            message(
                "something unexplained remains beside it, so it may be a proxy for something "
                "that varies alike"
            )
        )
    return {
        "number": number,
        "found": one,
        "status": _STATUSES[one.status],
        "status_words": status_words(one.status, evidence),
        "mark": MARKS[one.status],
        "facts": facts,
        "ties": [rival_name(one, tie) for tie in one.ties],
        "adoption": adoption_text(one),
        "can_be_adopted": not kind_of(one.kind).not_adopted,
        "warnings": [f"{capitalised(w, one.sensors)}." for w in warnings],
        "parameters": [
            (
                parameter_name(name),
                parameter_text(name, value, one.effect.standard_errors.get(name)),
            )
            for name, value in one.parameters.items()
        ],
        "curve": None if curve is None or not curve.driver else _curve(curve, result),
        "rivals": _rivals(one),
    }


def _slope_words(one: FoundEffect) -> str:
    """Say what held-out visits show of it."""
    slope, error = one.evidence.calibration_slope, one.evidence.calibration_slope_error
    if slope is None:
        return _("held-out visits say nothing about it")
    unsure = "" if error is None else f" ± {figure_text(error, 2)}"
    return _("held-out slope %(slope)s (1 is right)", slope=figure_text(slope, 2) + unsure)


def _curve(curve: EffectCurve, result: Analysis) -> dict[str, Any]:
    names = listed([component_name(code) for code in dict.fromkeys(curve.components)], 3)
    over_time = curve.over == TIME
    floor = _floor_of(curve.components, result)
    last = datetime.fromtimestamp(curve.driver[-1], UTC)
    unit = zone_name(last) if over_time else curve.over_unit
    return {
        "names": names,
        "unit": curve.unit,
        "over": said_plainly(f"{curve.over}, {unit}" if unit else curve.over),
        "band": floor is not None,
        "rows": [
            [f"{at:.4g}", *(figure_text(v, 2) for v in values)]
            for at, *values in list(
                zip(curve.driver, curve.before, curve.explained, curve.after, strict=True)
            )[:200]
        ],
        **residual_chart(
            Marks(curve.driver, curve.before, curve.after, curve.explained),
            floor,
            _(
                "Residuals of %(names)s in %(unit)s over %(over)s: within ±%(before)s before, "
                "±%(after)s after",
                names=names,
                unit=curve.unit,
                over=said_plainly(curve.over),
                before=marked(f"{largest([curve.before]):.3g}"),
                after=marked(f"{largest([curve.after]):.3g}"),
            ),
            over_time=over_time,
        ),
    }


def _floor_of(names: Sequence[str], result: Analysis) -> float | None:
    """Two floors of the components that are drawn; None where one has no floor."""
    floors = [c.floor for c in result.components if c.component in set(names)]
    known = [floor for floor in floors if floor is not None]
    return 2.0 * max(known) if known and len(known) == len(floors) else None


def _rivals(one: FoundEffect) -> dict[str, Any] | None:
    """Lay the evidence out as bars on one scale from zero; ties are as black as the effect."""
    own = one.evidence.two_ln_bayes_factor
    if own is None:
        return None
    shown = [a for a in one.alternatives if a.tied or a.evidence > 0.0][:MOST_RIVALS]
    ends = [own, VERY_STRONG, *(a.evidence for a in shown)]
    reach = 1.05 * max(ends)
    bars = [
        (explanation_name(one), own, True),
        *((rival_name(one, a), a.evidence, a.tied) for a in shown),
    ]
    lead = min((a.behind for a in one.alternatives), default=None)
    words = _("Dashed: 10, very strong.")
    if any(a.tied for a in one.alternatives):
        words += " " + _("These observations cannot tell the bars in bold apart.")
    elif lead is not None:
        words += " " + _("The lead is %(lead)s.", lead=figure_text(lead, 0))
    further = len(one.alternatives) - len(shown)
    if further:
        words += " " + counted(further, "%(count)s more is weaker.", "%(count)s more are weaker.")
    again = one.evidence.found_again_share
    if again is not None:
        words += " " + _("Found again in %(share).0f %% of the splits.", share=100.0 * again)
    return {
        "strong": round(100.0 * VERY_STRONG / reach, 2),
        "bars": [
            {
                "name": name,
                "value": figure_text(value, 0),
                "width": round(100.0 * max(value, 0.0) / reach, 2),
                "is_black": is_black,
            }
            for name, value, is_black in bars
        ],
        "words": words,
        "separating": [
            (rival_name(one, tie), tie.separating_measurement)
            for tie in one.ties
            if tie.separating_measurement
        ],
    }


def _by_unit(components: Sequence[ComponentFigures]) -> Iterator[dict[str, Any]]:
    """Group components of one unit on one scale; those that nothing changes fold into one row."""
    order = [unit.symbol for unit in Unit]
    for unit, together in groupby(
        sorted(components, key=lambda c: order.index(c.unit)), lambda c: c.unit
    ):
        own = sorted(together, key=lambda c: -c.shown_rms[0])
        decimals = decimals_for(median(c.noise for c in own))
        reach = round_up(1.05 * largest((*c.shown_rms, c.floor or 0.0) for c in own) or 1.0)
        rows = [_component(c, decimals, reach) for c in own]
        kept = [row for row in rows if row["is_changed"]] or rows[:3]
        yield {
            "unit": unit,
            "reach": f"{reach:.10g}",
            "rows": kept,
            "folded": [row for row in rows if row not in kept],
            "at_most": figure_text(
                max(
                    (c.shown_rms[0] for c, r in zip(own, rows, strict=True) if r not in kept),
                    default=0.0,
                ),
                decimals,
            ),
        }


def _component(one: ComponentFigures, decimals: int, reach: float) -> dict[str, Any]:
    before, after = one.shown_rms
    return {
        "name": component_name(one.component),
        "before": figure_text(before, decimals),
        "after": figure_text(after, decimals),
        "floor": "–" if one.floor is None else figure_text(one.floor, decimals),
        "why_no_floor": one.floor_unknown or "",
        "count": one.count,
        "is_changed": one.is_changed,
        "is_held_out": one.is_held_out,
        "at_before": round(100.0 * before / reach, 2),
        "at_after": round(100.0 * after / reach, 2),
        "at_floor": None if one.floor is None else round(100.0 * one.floor / reach, 2),
    }


def _visit_chart(result: Analysis) -> dict[str, Any] | None:
    """Draw the visits' means of the component that the first effect, or what is left, is of."""
    named = [name for e in result.effects for name in e.components]
    named += [part.component for part in result.unexplained]
    by_name = {c.component: c for c in result.plots.visits if len(c.time_s) > 1}
    one: VisitMeans | None = next((by_name[name] for name in named if name in by_name), None)
    if one is None:
        return None
    band = 2.0 * max(one.expected) if one.expected else None
    name = component_name(one.component)
    return {
        "name": name,
        "unit": one.unit,
        "has_band": band is not None,
        **residual_chart(
            Marks(one.time_s, one.before, one.after),
            band,
            f"Mean residuals of {name} by visit in {one.unit}, {len(one.time_s)} means: within "
            f"±{largest([one.before]):.3g} before, ±{largest([one.after]):.3g} after",
            over_time=True,
        ),
    }


def _proposal(one: TriedAssignment) -> dict[str, str]:
    return {
        "component": one.component,
        "sensor": one.other_sensor or "",
        "words": proposal_words(one),
    }


def _seen(result: Analysis, decimals: int) -> list[tuple[str, list[str]]]:
    """Say of each kind from which size on it would have been seen."""
    units = units_of(result.detectable)
    kinds = dict.fromkeys(one.kind for one in result.detectable)
    return [
        (
            kind_name(kind),
            [
                size_range([s for s in result.detectable if s.kind == kind], unit, decimals)
                for unit in units
            ],
        )
        for kind in kinds
    ]
