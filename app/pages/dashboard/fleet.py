"""The page of the fleet: how far its analyses are, who drifts, and what sisters share."""

from __future__ import annotations

import json
from datetime import datetime
from typing import Any

from app.pages.dashboard.loop import JOBS
from app.pages.environment import render_live
from app.pages.fleet_report import ANSWERS, gain_text, parameters, rms_text, share_text
from app.pages.report_parts.effect_names import MARKS, STATUSES, VERDICTS, explanation_name
from app.pages.wording import _, counted, said, said_plainly
from app.services.fleet import HOLDOUT, FleetMember, FleetRequest, FleetView
from app.storage.records import AnalysisStatus


def fleet_page(view: FleetView, now: datetime, question: FleetRequest) -> str:
    """Write the page of all machines' analyses together."""
    going_on = [one for one in view.machines if one.is_going_on]
    ended = [one for one in view.machines if one.analysis is not None and not one.is_going_on]
    asked = [one for one in view.machines if one.analysis is not None]
    to_ask = [one for one in view.machines if one.to_be_asked]
    judged = {} if view.judgement is None else {m.machine: m for m in view.judgement.machines}
    return render_live(
        "dashboard/fleet.html",
        page="fleet",
        stream="/v1/stream",
        now=now,
        view=view,
        title=_title(view, len(to_ask)),
        progress=_progress(view, len(ended), len(asked)),
        share=_share(view),
        asked=json.dumps(_body(question)),
        question=question,
        is_usual=question == FleetRequest(),
        command=_command(question),
        start_words=counted(len(to_ask), "Analyse %(count)s machine", "Analyse %(count)s machines")
        if to_ask
        else "",
        cancel_words=counted(
            len(going_on), "Cancel %(count)s analysis", "Cancel %(count)s analyses"
        )
        if going_on
        else "",
        rows=[_row(one, judged.get(one.machine)) for one in _ordered(view, judged)],
        several=[e for e in judged_effects(view) if len(e.found_on) > 1],
        effects=judged_effects(view),
        explanation_name=explanation_name,
        rms_text=rms_text,
        gain_text=gain_text,
        share_text=share_text,
        parameters=lambda effect: dict(parameters(effect)),
        ANSWERS=ANSWERS,
        MARKS=MARKS,
        STATUSES=STATUSES,
        VERDICTS=VERDICTS,
    )


def _body(question: FleetRequest) -> dict[str, Any]:
    return question.model_dump()


def _command(question: FleetRequest) -> str:
    """Write what asks the same in a shell.

    >>> _command(FleetRequest(effects=["backlash"], holdout_fraction=0.4))
    'thermap analyse --fleet --effects backlash --holdout 0.4'
    """
    words = ["thermap analyse --fleet", *(f"--effects {kind}" for kind in question.effects or ())]
    if question.holdout_fraction != HOLDOUT:
        words.append(f"--holdout {question.holdout_fraction:g}")
    return " ".join(words)


def judged_effects(view: FleetView) -> list[Any]:
    """List what was found, on most machines first."""
    return [] if view.judgement is None else list(view.judgement.effects)


def _ordered(view: FleetView, judged: dict[str, Any]) -> list[FleetMember]:
    """Put those that drift first, where that is known."""
    order = list(judged)
    known = {name: i for i, name in enumerate(order)}
    return sorted(view.machines, key=lambda one: known.get(one.machine, len(order)))


def _title(view: FleetView, to_ask: int) -> str:
    is_analysed = any(one.analysis is not None for one in view.machines)
    if view.judgement is not None and is_analysed:
        summary = said(view.judgement.summary)
        if not to_ask:
            return summary
        more = counted(
            to_ask, "%(count)s machine is not analysed.", "%(count)s machines are not analysed."
        )
        return summary + " " + more
    if view.tried < view.wanted:
        return _("What was found is being tried on sisters.")
    if view.going_on:
        return _("The machines are being analysed.")
    if to_ask:
        return counted(
            to_ask,
            "%(count)s machine can be analysed: checks are stored.",
            "%(count)s machines can be analysed: checks are stored.",
        )
    return _("No machine can be analysed: none has a model and a check.")


def _progress(view: FleetView, ended: int, asked: int) -> str:
    if view.tried < view.wanted:
        return counted(
            view.wanted,
            "%(tried)s of %(count)s trial done, while this page is open.",
            "%(tried)s of %(count)s trials done, while this page is open.",
            tried=view.tried,
        )
    return counted(
        asked,
        "%(ended)s of %(count)s analysis ended. The others go on when this page is left.",
        "%(ended)s of %(count)s analyses ended. The others go on when this page is left.",
        ended=ended,
    )


def _share(view: FleetView) -> float:
    """Say how much of the analyses is done, 0 to 1; trials come after them."""
    if view.wanted:
        return view.tried / view.wanted
    jobs = [one.analysis for one in view.machines if one.analysis is not None]
    done = [
        job.progress
        if job.status is AnalysisStatus.RUNNING
        else float(job.status not in (AnalysisStatus.QUEUED,))
        for job in jobs
    ]
    return sum(done) / len(done) if done else 0.0


def _row(one: FleetMember, judged: Any) -> dict[str, Any]:
    job = one.analysis
    if one.why_not:
        state = _("cannot be analysed: %(why)s", why=said_plainly(one.why_not))
    elif job is None:
        state = _("not analysed yet")
    elif job.status is AnalysisStatus.RUNNING:
        state = _(
            "analysis %(number)s runs: %(share).0f %%, %(doing)s",
            number=job.id,
            share=100 * job.progress,
            doing=said_plainly(job.message),
        )
    elif job.status is AnalysisStatus.QUEUED:
        state = _("analysis %(number)s waits", number=job.id)
    elif job.status is AnalysisStatus.DONE:
        state = _("analysis %(number)s done", number=job.id)
    else:
        word, message = _("analysis"), said_plainly(job.message)
        state = f"{word} {job.id} {_(JOBS[job.status])}: {message}"
    return {"member": one, "state": state, "judged": judged}
