"""What model versions leave of verifications."""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Any, Final

import orjson
from fastapi import Header, Query
from pydantic import TypeAdapter
from starlette.responses import Response

from app.access.keys import Role
from app.api.access import needs
from app.api.bodies import BodyRoute
from app.api.dependencies import ContextDep, MachinePath, VerificationPath
from app.api.media_types import CSV, HTML, JSON
from app.api.negotiation import chosen_form
from app.api.pages import Page
from app.api.residual_rows import residual_rows, residuals_csv
from app.api.router import Router
from app.identification.analysis.residual_curves import residual_curves
from app.identification.analysis.residual_report import ResidualFigures
from app.pages.residuals_page import ResidualsHead, residuals_page
from app.rounding import to_digits_in
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

router = Router(route_class=BodyRoute, prefix="/v1/machines/{machine}", tags=["closing the loop"])

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
    return _response(
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
    return _response(shown, body.rows, accept)


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


def _response(shown: ShownResiduals, rows: int, accept: str) -> Response:
    headers = {"Vary": "Accept", "Cache-Control": "no-cache"}
    form = chosen_form(accept, [JSON, CSV, HTML])
    if form == CSV:
        return Response(residuals_csv(shown), media_type=CSV, headers=headers)
    if form == HTML:
        return Page(_page(shown), scripts=2, headers=headers)
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


def _page(shown: ShownResiduals) -> str:
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
