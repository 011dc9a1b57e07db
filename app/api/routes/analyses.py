"""Analyses: what the model lacks, found by a job; and the adoption of what was found."""

from __future__ import annotations

from typing import Annotated

import orjson
from fastapi import APIRouter, Depends, Response
from fastapi.responses import HTMLResponse

from app.api.dependencies import AnalysisPath, ContextDep, MachinePath, get_runner
from app.api.media_types import JSON
from app.api.schemas.analyses import (
    AdoptionRequest,
    AnalysisAnswer,
    AnalysisHead,
    AnalysisRequest,
    PlanRequest,
)
from app.api.schemas.models import ModelAnswer
from app.api.schemas.plan import PlanAnswer
from app.api.table_json import OPTIONS
from app.services.adopt_analysis import adopt_analysis
from app.services.cancel_analysis import cancel_analysis
from app.services.delete_analysis import delete_analysis
from app.services.plan_analysis import plan_analysis
from app.services.report_analysis import report_analysis
from app.services.request_analysis import request_analysis
from app.services.run_analyses import AnalysisRunner
from app.services.show_analyses import show_analyses, show_analysis

router = APIRouter(prefix="/v1/machines/{machine}/analyses", tags=["closing the loop"])

RunnerDep = Annotated[AnalysisRunner, Depends(get_runner)]


@router.post("", status_code=202, summary="Ask for an analysis")
def post_analysis(
    context: ContextDep,
    runner: RunnerDep,
    machine: MachinePath,
    body: AnalysisRequest,
    response: Response,
) -> AnalysisHead:
    """Hold the active model against verifications, as a job: look at it until it is done."""
    queued = request_analysis(
        context,
        machine,
        body.verifications,
        holdout_fraction=body.holdout_fraction,
        kinds=body.effects,
        seed=body.seed,
    )
    runner.wake()
    response.headers["Location"] = f"/v1/machines/{machine}/analyses/{queued.id}"
    return AnalysisHead.of(queued)


@router.post("/plan", summary="Say what planned observations could see")
def post_plan(context: ContextDep, machine: MachinePath, body: PlanRequest) -> PlanAnswer:
    """Tell, before anyone measures, which effects could be seen and told apart at what size.

    Times to come are planned on recorded days; visits that would help most are suggested.
    """
    return PlanAnswer.of(
        *plan_analysis(context, machine, body.to_verifications(), body.verifications)
    )


@router.get("", summary="List analyses")
def get_analyses(context: ContextDep, machine: MachinePath) -> list[AnalysisHead]:
    """List a machine's analyses without their results, oldest first."""
    return [AnalysisHead.of(stored) for stored in show_analyses(context, machine)]


@router.get("/{analysis_id}", summary="Show an analysis", response_model=AnalysisAnswer)
def get_analysis(context: ContextDep, machine: MachinePath, analysis_id: AnalysisPath) -> Response:
    """Show how far an analysis is and, once it is done, what it found."""
    stored, result = show_analysis(context, machine, analysis_id)
    fields = AnalysisHead.of(stored).model_dump()
    fields["result"] = None if result is None else orjson.Fragment(result)
    return Response(orjson.dumps(fields, option=OPTIONS), media_type=JSON)


@router.get("/{analysis_id}/report", summary="Report of an analysis", response_class=HTMLResponse)
def get_report(context: ContextDep, machine: MachinePath, analysis_id: AnalysisPath) -> str:
    """Show what was found as a page that a person reads; it needs no other file, and prints."""
    return report_analysis(context, machine, analysis_id)


@router.post("/{analysis_id}/cancel", summary="Cancel an analysis")
def post_cancel(
    context: ContextDep, runner: RunnerDep, machine: MachinePath, analysis_id: AnalysisPath
) -> AnalysisHead:
    """Cancel an analysis that waits or runs; cancelling again changes nothing."""
    cancelled = cancel_analysis(context, machine, analysis_id)
    runner.wake()
    return AnalysisHead.of(cancelled)


@router.post("/{analysis_id}/adopt", summary="Adopt what an analysis found")
def post_adopt(
    context: ContextDep,
    machine: MachinePath,
    analysis_id: AnalysisPath,
    body: AdoptionRequest | None = None,
) -> ModelAnswer:
    """Make the next, active model version with these effects: whole, and once.

    Tables, predictions, streams and exports contain them from then on; activating the
    version before takes them back.
    """
    asked = body or AdoptionRequest()
    version = adopt_analysis(
        context, machine, analysis_id, asked.effects, onto_active=asked.onto_active
    )
    return ModelAnswer.of(version, version.version)


@router.delete("/{analysis_id}", status_code=204, summary="Delete an analysis")
def remove_analysis(
    context: ContextDep, runner: RunnerDep, machine: MachinePath, analysis_id: AnalysisPath
) -> None:
    """Delete an analysis; a running one is ended, and a model version made of it stays."""
    delete_analysis(context, machine, analysis_id)
    runner.wake()
