"""The loop: verifications, what versions leave of them, analyses, and those of all machines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from datetime import UTC, datetime
from typing import Annotated, Any, Final
from urllib.parse import quote

import orjson
from fastapi import Header, Query, Request
from fastapi.responses import HTMLResponse
from pydantic import TypeAdapter
from starlette.responses import Response

from app.access.keys import Role
from app.answer import fields_of
from app.api.access import needs
from app.api.bodies import BodyRoute, body_of_at_most
from app.api.dependencies import (
    AcceptLossesQuery,
    AnalysisPath,
    ContextDep,
    FleetQuestionQuery,
    MachinePath,
    PreviewQuery,
    RunnerDep,
    VerificationPath,
)
from app.api.media_types import CSV, HTML, JSON
from app.api.negotiation import chosen_form
from app.api.pages import Page, take_reader
from app.api.residual_rows import residual_rows, residuals_csv
from app.api.router import Router
from app.api.table_json import OPTIONS
from app.effects.observations import Verification
from app.identification.analysis.residual_curves import residual_curves
from app.identification.analysis.residual_report import ResidualFigures
from app.identification.analysis.tried_effect import TriedEffect
from app.identification.plan.plan import Plan
from app.pages.analysis_report import analysis_report, visits_page
from app.pages.residuals_page import ResidualsHead, residuals_page
from app.rounding import to_digits_in
from app.services.adopt_analysis import AdoptionRequest, adopt_analysis, preview_adoption
from app.services.analyses import (
    AnalysisRequest,
    PlanRequest,
    TriedEffectRequest,
    cancel_analysis,
    delete_analysis,
    plan_analysis,
    report_analysis,
    request_analysis,
    show_analyses,
    show_analysis,
    try_found_effect,
)
from app.services.context import Context
from app.services.fleet import FleetRequest, FleetView, analyse_fleet, cancel_fleet, show_fleet
from app.services.models import ChangedModelAnswer, Preview
from app.services.observations import MeasuredObservation, VerificationRequest
from app.services.residuals import (
    MOST_ROWS,
    ComparisonRequest,
    ModelComparison,
    ResidualsAnswer,
    ResidualsRequest,
    ShownResiduals,
    compare_models,
    show_residuals,
)
from app.services.verifications import (
    StoredVerificationAnswer,
    Watch,
    WholeVerificationAnswer,
    delete_verification,
    remarks_on_verification,
    show_verification,
    show_verifications,
    show_watch,
    store_verification,
)
from app.storage.analysis_results import AnalysisWithResult
from app.storage.records import StoredAnalysis, StoredVerification

router = Router(route_class=BodyRoute, prefix="/v1/machines/{machine}", tags=["closing the loop"])

_STORED: Final = TypeAdapter(StoredVerification)

_NOTHING_NEW: Final[dict[int | str, dict[str, Any]]] = {
    200: {
        "model": StoredVerificationAnswer,
        "description": "The verification, which is stored already",
    }
}


@router.post(
    "/verifications",
    status_code=201,
    summary="Store a verification",
    responses=_NOTHING_NEW,
    openapi_extra=body_of_at_most(32),
)
def post_verification(
    context: ContextDep, machine: MachinePath, body: VerificationRequest, response: Response
) -> StoredVerificationAnswer:
    """Store up to 100,000 observations: all of them or, if one is wrong, none.

    The same content under the same label again answers 200 with the stored verification. What
    the active model has no table for is stored too; `warnings` say that nothing is compared
    with it.
    """
    return answer_to_verification(context, machine, body.to_verification(), response)


@router.get("/verifications", summary="List verifications")
def get_verifications(context: ContextDep, machine: MachinePath) -> list[StoredVerification]:
    """List a machine's verifications without their observations, oldest first."""
    return show_verifications(context, machine)


@router.get(
    "/verifications/{verification_id}",
    summary="Show a verification",
    response_model=WholeVerificationAnswer,
)
def get_verification(
    context: ContextDep, machine: MachinePath, verification_id: VerificationPath
) -> Response:
    """Show one verification with its observations, in our components and signs."""
    stored, verification = show_verification(context, machine, verification_id)
    head = _STORED.dump_python(stored)
    head["observations"] = [
        MeasuredObservation.of(o, datetime.fromtimestamp(o.time_s, UTC))
        for o in verification.observations
    ]
    return Response(orjson.dumps(head, option=OPTIONS), media_type=JSON)


@router.delete("/verifications/{verification_id}", status_code=204, summary="Delete a verification")
def remove_verification(
    context: ContextDep, machine: MachinePath, verification_id: VerificationPath
) -> None:
    """Delete a verification; analyses of it keep their results."""
    delete_verification(context, machine, verification_id)


@router.get("/watch", summary="Whether the machine still is as its model says")
def get_watch(context: ContextDep, machine: MachinePath) -> Watch:
    """Show where the sequential test of the active version stands, over all verifications.

    An unchanged machine is ever called changed with a probability of at most `false_alarm`,
    however often it is looked at. Each model version has a test of its own.
    """
    return show_watch(context, machine)


def answer_to_verification(
    context: Context,
    machine: str,
    verification: Verification,
    response: Response,
    notes: Sequence[str] = (),
) -> StoredVerificationAnswer:
    """Store a verification, whichever way it came; `notes` are of its file."""
    outcome = store_verification(context, machine, verification)
    response.status_code = 201 if outcome.is_new else 200
    response.headers["Location"] = f"/v1/machines/{machine}/verifications/{outcome.stored.id}"
    remarks = remarks_on_verification(context, machine, verification)
    return StoredVerificationAnswer(**fields_of(outcome.stored), warnings=[*notes, *remarks])


Accept = Annotated[str, Header(description=f"`{JSON}`, `{CSV}` or `{HTML}`")]

_COMPARISON: Final = TypeAdapter(ModelComparison)
_RESIDUALS: Final = TypeAdapter(ResidualsAnswer)

_FORMS: dict[int | str, dict[str, Any]] = {
    200: {
        "model": ResidualsAnswer,
        "content": {media_type: {"schema": {"type": "string"}} for media_type in (CSV, HTML)},
    }
}


@router.get(
    "/verifications/{verification_id}/residuals",
    summary="Residuals of one verification",
    responses=_FORMS,
    response_model=ResidualsAnswer,
)
def get_residuals(
    context: ContextDep,
    machine: MachinePath,
    verification_id: VerificationPath,
    model_version: Annotated[
        int | None, Query(description="Version; the active one if not stated")
    ] = None,
    rows: Annotated[
        int, Query(ge=0, le=MOST_ROWS, description="How many single residuals are shown too")
    ] = 0,
    accept: Accept = JSON,
) -> Response:
    """Subtract what the model says from what was measured; a browser is shown a page."""
    return _residuals_response(
        show_residuals(context, machine, [verification_id], model_version), rows, accept
    )


@router.post(
    "/residuals",
    summary="Residuals of several verifications",
    responses=_FORMS,
    response_model=ResidualsAnswer,
)
@needs(Role.VIEWER)
def post_residuals(
    context: ContextDep, machine: MachinePath, body: ResidualsRequest, accept: Accept = JSON
) -> Response:
    """Subtract what the model says from all that was measured; nothing is fitted."""
    shown = show_residuals(context, machine, body.verifications, body.model_version)
    return _residuals_response(shown, body.rows, accept)


@router.post(
    "/models/compare",
    summary="Compare model versions on verifications",
    response_model=ModelComparison,
)
@needs(Role.VIEWER)
def post_comparison(context: ContextDep, machine: MachinePath, body: ComparisonRequest) -> Response:
    """Show versions side by side, on the observations that can be compared with all of them."""
    compared = compare_models(context, machine, body.verifications, body.versions)
    answer = _COMPARISON.dump_python(compared, mode="json")
    return Response(orjson.dumps(to_digits_in(answer)), media_type=JSON)


def _residuals_response(shown: ShownResiduals, rows: int, accept: str) -> Response:
    headers = {"Vary": "Accept", "Cache-Control": "no-cache"}
    form = chosen_form(accept, [JSON, CSV, HTML])
    if form == CSV:
        return Response(residuals_csv(shown), media_type=CSV, headers=headers)
    if form == HTML:
        return Page(_residuals_page(shown), scripts=2, headers=headers)
    report = shown.report
    answer = ResidualsAnswer(
        **{field.name: getattr(report, field.name) for field in fields(ResidualFigures)},
        model_version=shown.model_version,
        verifications=shown.verification_ids,
        counted_as_zero=report.residuals.counted_as_zero,
        rows=residual_rows(shown, rows),
    )
    written = to_digits_in(_RESIDUALS.dump_python(answer, mode="json"), stored=("measured",))
    return Response(orjson.dumps(written), media_type=JSON, headers=headers)


def _residuals_page(shown: ShownResiduals) -> str:
    """Write residuals as HTML that needs no other file."""
    residuals = shown.report.residuals
    machine, times_s = residuals.projection.model.machine, residuals.rows.times_s
    head = ResidualsHead(
        machine_id=machine.id,
        machine_name=machine.name,
        chain=machine.chain.text,
        model_version=shown.model_version,
        verifications=[(v.label, str(v.datum)) for v in shown.verifications],
        first_s=float(times_s.min()),
        last_s=float(times_s.max()),
        serial_number=machine.serial_number,
        instruments=[v.instrument for v in shown.verifications],
        operators=[v.operator for v in shown.verifications],
        temperatures_c=residuals.temperature_ranges,
    )
    back = f"/machines/{machine.id}/loop"
    return residuals_page(head, shown.report, residual_curves(shown.report), back=back)


_WITH_RESULT: Final = TypeAdapter(AnalysisWithResult)


@router.post("/analyses", status_code=202, summary="Ask for an analysis")
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
    "/analyses/plan",
    summary="Say what planned observations could see",
    openapi_extra=body_of_at_most(32),
)
@needs(Role.VIEWER)
def post_plan(context: ContextDep, machine: MachinePath, body: PlanRequest) -> Plan:
    """Say, before anything is measured, how small an effect could be seen and told from others.

    Future times are planned on recorded days; the visits that would help most are suggested.
    """
    return plan_analysis(context, machine, body)


@router.get("/analyses", summary="List analyses")
def get_analyses(context: ContextDep, machine: MachinePath) -> list[StoredAnalysis]:
    """List a machine's analyses without their results, oldest first."""
    return show_analyses(context, machine)


@router.get(
    "/analyses/{analysis_id}", summary="Show an analysis", response_model=AnalysisWithResult
)
def get_analysis(context: ContextDep, machine: MachinePath, analysis_id: AnalysisPath) -> Response:
    """Show how far an analysis is and, once it is done, what it found."""
    analysis = show_analysis(context, machine, analysis_id)
    answer = _WITH_RESULT.dump_python(analysis, mode="json")
    # What adoption stores stays as it is.
    written = orjson.dumps(to_digits_in(answer, stored=("effect",)))
    return Response(written, media_type=JSON)


@router.get(
    "/analyses/{analysis_id}/report", summary="Report of an analysis", response_class=HTMLResponse
)
def get_report(
    request: Request, context: ContextDep, machine: MachinePath, analysis_id: AnalysisPath
) -> Page:
    """Show what was found as a page for people to read; it needs no other file, and prints."""
    take_reader(request)
    head, result = report_analysis(context, machine, analysis_id)
    return Page(analysis_report(head, result, back=_loop_address(machine, analysis_id)), scripts=2)


@router.get(
    "/analyses/{analysis_id}/visits",
    summary="Visits to make, as a list",
    response_class=HTMLResponse,
)
def get_visits(
    request: Request, context: ContextDep, machine: MachinePath, analysis_id: AnalysisPath
) -> Page:
    """Show the visits that would settle what is open as a page to print and to write on."""
    take_reader(request)
    head, result = report_analysis(context, machine, analysis_id)
    return Page(
        visits_page(head, result.next_visits, back=_loop_address(machine, analysis_id)), scripts=2
    )


def _loop_address(machine: str, analysis_id: int) -> str:
    """Give the address of the page from which an analysis is opened."""
    return f"/machines/{quote(machine)}/loop?analysis={analysis_id}"


@router.post("/analyses/{analysis_id}/cancel", summary="Cancel an analysis")
def post_cancel(
    context: ContextDep, runner: RunnerDep, machine: MachinePath, analysis_id: AnalysisPath
) -> StoredAnalysis:
    """Cancel a waiting or running analysis; cancelling again changes nothing."""
    cancelled = cancel_analysis(context, machine, analysis_id)
    runner.wake()
    return cancelled


@router.post("/analyses/{analysis_id}/adopt", summary="Adopt what an analysis found")
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


@router.delete("/analyses/{analysis_id}", status_code=204, summary="Delete an analysis")
def remove_analysis(
    context: ContextDep, runner: RunnerDep, machine: MachinePath, analysis_id: AnalysisPath
) -> None:
    """Delete an analysis; a running one is ended, and a model version made of it stays."""
    delete_analysis(context, machine, analysis_id)
    runner.wake()


_fleet = Router(route_class=BodyRoute, prefix="/v1/fleet", tags=["closing the loop"])


@_fleet.get("", summary="Show what all machines' analyses say together")
@needs(Role.VIEWER, all_machines=True)
def get_fleet(context: ContextDep, question: FleetQuestionQuery) -> FleetView:
    """Say how far the analysis of every machine is, and what they all say together.

    An analysis serves that asked the same of the active model and all stored verifications. What
    helps where it was found is tried on sisters: for two seconds at most in one answer, so ask
    again until nothing goes on.
    """
    return show_fleet(context, question)


@_fleet.post("/analyses", status_code=202, summary="Analyse every machine")
@needs(Role.METROLOGIST, all_machines=True)
def post_analyses(
    context: ContextDep, runner: RunnerDep, body: FleetRequest | None = None
) -> FleetView:
    """Ask for the analyses that are missing, and again for those that failed or were cancelled.

    What was asked already serves, by whomever. `refused` says which machine's could not be asked.
    """
    view = analyse_fleet(context, body or FleetRequest())
    runner.wake()
    return view


@_fleet.post("/analyses/cancel", summary="Cancel the analyses of every machine")
@needs(Role.METROLOGIST, all_machines=True)
def post_fleet_cancel(
    context: ContextDep, runner: RunnerDep, body: FleetRequest | None = None
) -> FleetView:
    """Cancel the waiting and running analyses that asked this; finished ones stay."""
    view = cancel_fleet(context, body or FleetRequest())
    runner.wake()
    return view


@_fleet.post("/tried-effects", summary="Try an effect of one machine on another")
@needs(Role.VIEWER, all_machines=True)
def post_tried_effect(context: ContextDep, body: TriedEffectRequest) -> TriedEffect:
    """Try an effect that was found on one machine, unchanged, on another one.

    Nothing is fitted and nothing is stored: every set-up of the other machine is held out.
    """
    return try_found_effect(context, body)


router.routes.extend(_fleet.routes)
