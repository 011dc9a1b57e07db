"""The page of the fleet: how far its analyses are, who drifts, and what sisters share."""

from __future__ import annotations

import json
from datetime import datetime
from typing import Any

from app.errors import counted
from app.pages.environment import render_live
from app.pages.fleet_report import ANSWERS, gain_text, parameters, rms_text, share_text
from app.pages.report_parts.effect_names import MARKS, STATUSES, VERDICTS, explanation_name
from app.services.fleet import HOLDOUT, FleetMember, FleetQuestion, FleetView
from app.storage.records import AnalysisStatus


def fleet_page(view: FleetView, now: datetime, question: FleetQuestion) -> str:
    """Write the page of all machines' analyses together."""
    going_on = [one for one in view.members if one.is_going_on]
    ended = [one for one in view.members if one.job is not None and not one.is_going_on]
    asked = [one for one in view.members if one.job is not None]
    to_ask = [one for one in view.members if one.is_to_be_asked]
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
        is_usual=question == FleetQuestion(),
        command=_command(question),
        start_words=f"Analyse {counted(len(to_ask), 'machine')}" if to_ask else "",
        cancel_words=f"Cancel {counted(len(going_on), 'analysis', 'analyses')}" if going_on else "",
        rows=[_row(one, judged.get(one.id)) for one in _ordered(view, judged)],
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


def _body(question: FleetQuestion) -> dict[str, Any]:
    """Write what is asked as the routes take it."""
    kinds = None if question.kinds is None else list(question.kinds)
    return {"effects": kinds, "holdout_fraction": question.holdout_fraction}


def _command(question: FleetQuestion) -> str:
    """Write what asks the same in a shell.

    >>> _command(FleetQuestion(["backlash"], 0.4))
    'thermap analyse --fleet --effects backlash --holdout 0.4'
    """
    words = ["thermap analyse --fleet", *(f"--effects {kind}" for kind in question.kinds or ())]
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
    return sorted(view.members, key=lambda one: known.get(one.id, len(order)))


def _title(view: FleetView, to_ask: int) -> str:
    is_analysed = any(one.job is not None for one in view.members)
    if view.judgement is not None and is_analysed:
        more = f" {counted(to_ask, 'machine')} not analysed." if to_ask else ""
        return view.judgement.summary + more
    if view.tried < view.wanted:
        return "What was found is being tried on sisters."
    if view.is_going_on:
        return "The machines are being analysed."
    if to_ask:
        return f"{counted(to_ask, 'machine')} can be analysed: checks are stored."
    return "No machine can be analysed: none has a model and a check."


def _progress(view: FleetView, ended: int, asked: int) -> str:
    if view.tried < view.wanted:
        return f"{view.tried} of {counted(view.wanted, 'trial')} done, while this page is open."
    every = counted(asked, "analysis", "analyses")
    return f"{ended} of {every} ended. The others go on when this page is left."


def _share(view: FleetView) -> float:
    """Say how much of the analyses is done, 0 to 1; trials come after them."""
    if view.wanted:
        return view.tried / view.wanted
    jobs = [one.job for one in view.members if one.job is not None]
    done = [
        job.progress
        if job.status is AnalysisStatus.RUNNING
        else float(job.status not in (AnalysisStatus.QUEUED,))
        for job in jobs
    ]
    return sum(done) / len(done) if done else 0.0


def _row(one: FleetMember, judged: Any) -> dict[str, Any]:
    job = one.job
    if one.why_not:
        state = f"cannot be analysed: {one.why_not}"
    elif job is None:
        state = "not analysed yet"
    elif job.status is AnalysisStatus.RUNNING:
        state = f"analysis {job.id} runs: {100 * job.progress:.0f} %, {job.message}"
    elif job.status is AnalysisStatus.QUEUED:
        state = f"analysis {job.id} waits"
    elif job.status is AnalysisStatus.DONE:
        state = f"analysis {job.id} done"
    else:
        state = f"analysis {job.id} {job.status}: {job.message}"
    return {"member": one, "state": state, "judged": judged}
