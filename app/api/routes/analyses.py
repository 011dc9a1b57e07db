"""Analyses: what the model lacks, found by a job; and the adoption of what was found."""

from __future__ import annotations

from typing import Final
from urllib.parse import quote

import orjson
from fastapi import Request, Response
from fastapi.responses import HTMLResponse
from pydantic import TypeAdapter

from app.access.keys import Role
from app.api.access import needs
from app.api.bodies import BodyRoute, body_of_at_most
from app.api.dependencies import (
    AcceptLossesQuery,
    AnalysisPath,
    ContextDep,
    MachinePath,
    PreviewQuery,
    RunnerDep,
)
from app.api.media_types import JSON
from app.api.pages import Page, take_reader
from app.api.router import Router
from app.identification.plan.plan import Plan
from app.pages.analysis_report import analysis_report, visits_page
from app.rounding import to_digits_in
from app.services.adopt_analysis import AdoptionRequest, adopt_analysis, preview_adoption
from app.services.analyses import (
    AnalysisRequest,
    PlanRequest,
    cancel_analysis,
    delete_analysis,
    plan_analysis,
    report_analysis,
    request_analysis,
    show_analyses,
    show_analysis,
)
from app.services.models import ChangedModelAnswer, Preview
from app.storage.analysis_results import AnalysisWithResult
from app.storage.records import StoredAnalysis

router = Router(
    route_class=BodyRoute, prefix="/v1/machines/{machine}/analyses", tags=["closing the loop"]
)

_WITH_RESULT: Final = TypeAdapter(AnalysisWithResult)


@router.post("", status_code=202, summary="Ask for an analysis")
def post_analysis(
    context: ContextDep,
    runner: RunnerDep,
    machine: MachinePath,
    body: AnalysisRequest,
    response: Response,
) -> StoredAnalysis:
    """Compare the active model with verifications, as a job: ask for it until it is done."""
    queued = request_analysis(context, machine, body)
    runner.wake()
    response.headers["Location"] = f"/v1/machines/{machine}/analyses/{queued.id}"
    return queued


@router.post(
    "/plan", summary="Say what planned observations could see", openapi_extra=body_of_at_most(32)
)
@needs(Role.VIEWER)
def post_plan(context: ContextDep, machine: MachinePath, body: PlanRequest) -> Plan:
    """Say, before anything is measured, how small an effect could be seen and told from others.

    Future times are planned on recorded days; the visits that would help most are suggested.
    """
    return plan_analysis(context, machine, body)


@router.get("", summary="List analyses")
def get_analyses(context: ContextDep, machine: MachinePath) -> list[StoredAnalysis]:
    """List a machine's analyses without their results, oldest first."""
    return show_analyses(context, machine)


@router.get("/{analysis_id}", summary="Show an analysis", response_model=AnalysisWithResult)
def get_analysis(context: ContextDep, machine: MachinePath, analysis_id: AnalysisPath) -> Response:
    """Show how far an analysis is and, once it is done, what it found."""
    analysis = show_analysis(context, machine, analysis_id)
    answer = _WITH_RESULT.dump_python(analysis, mode="json")
    # What adoption stores stays as it is.
    written = orjson.dumps(to_digits_in(answer, stored=("effect",)))
    return Response(written, media_type=JSON)


@router.get("/{analysis_id}/report", summary="Report of an analysis", response_class=HTMLResponse)
def get_report(
    request: Request, context: ContextDep, machine: MachinePath, analysis_id: AnalysisPath
) -> Page:
    """Show what was found as a page for people to read; it needs no other file, and prints."""
    take_reader(request)
    head, result = report_analysis(context, machine, analysis_id)
    return Page(analysis_report(head, result, back=_loop(machine, analysis_id)), scripts=2)


@router.get(
    "/{analysis_id}/visits", summary="Visits to make, as a list", response_class=HTMLResponse
)
def get_visits(
    request: Request, context: ContextDep, machine: MachinePath, analysis_id: AnalysisPath
) -> Page:
    """Show the visits that would settle what is open as a page to print and to write on."""
    take_reader(request)
    head, result = report_analysis(context, machine, analysis_id)
    return Page(visits_page(head, result.next_visits, back=_loop(machine, analysis_id)), scripts=2)


def _loop(machine: str, analysis_id: int) -> str:
    """Give the address of the page from which an analysis is opened."""
    return f"/machines/{quote(machine)}/loop?analysis={analysis_id}"


@router.post("/{analysis_id}/cancel", summary="Cancel an analysis")
def post_cancel(
    context: ContextDep, runner: RunnerDep, machine: MachinePath, analysis_id: AnalysisPath
) -> StoredAnalysis:
    """Cancel a waiting or running analysis; cancelling again changes nothing."""
    cancelled = cancel_analysis(context, machine, analysis_id)
    runner.wake()
    return cancelled


@router.post("/{analysis_id}/adopt", summary="Adopt what an analysis found")
def post_adopt(
    context: ContextDep,
    machine: MachinePath,
    analysis_id: AnalysisPath,
    body: AdoptionRequest | None = None,
    preview: PreviewQuery = False,
    accept_losses: AcceptLossesQuery = False,
) -> ChangedModelAnswer | Preview:
    """Make the next, active model version with these effects: all of them or none, and only once.

    From then on tables, predictions and everything made from them contain the effects; activating
    the version before takes them back. Where tables would no longer be complete, because an
    effect needs a state that readings do not state, the version is stored and waits.
    """
    adoption = body or AdoptionRequest()
    if preview:
        return preview_adoption(context, machine, analysis_id, adoption)
    return adopt_analysis(context, machine, analysis_id, adoption, accept_losses=accept_losses)


@router.delete("/{analysis_id}", status_code=204, summary="Delete an analysis")
def remove_analysis(
    context: ContextDep, runner: RunnerDep, machine: MachinePath, analysis_id: AnalysisPath
) -> None:
    """Delete an analysis; a running one is ended, and a model version made of it stays."""
    delete_analysis(context, machine, analysis_id)
    runner.wake()
