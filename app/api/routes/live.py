"""The live table, from memory; predictions; whether machines can be trusted now."""

from __future__ import annotations

from typing import Annotated

from fastapi import Header, Request
from starlette.responses import Response

from app.access.keys import Role
from app.api.access import needs, sees
from app.api.bodies import BodyRoute, DirectRoute, Written, body_of_at_most
from app.api.dependencies import (
    ContextDep,
    MachinePath,
    machine_in_memory,
    machine_with_readings,
)
from app.api.media_types import JSON
from app.api.router import Router
from app.api.table_json import (
    CompensationAnswer,
    CompensationRequest,
    CurrentCompensationAnswer,
    current_table_json,
    table_json,
)
from app.services.live_table import current_state, current_table, database_warnings, table_at
from app.services.observations import PredictionRequest
from app.services.predictions import Predictions, predict_errors
from app.services.status import show_status, show_statuses
from app.status.machine_status import MachineStatus

_direct = Router(route_class=DirectRoute, prefix="/v1/machines/{machine}", tags=["live"])


@_direct.post(
    "/compensation",
    summary="Compensation table for stated temperatures",
    response_model=CompensationAnswer,
)
@needs(Role.VIEWER)
async def post_compensation(
    request: Request, context: ContextDep, machine: MachinePath, body: CompensationRequest
) -> Response:
    """Compute the table at these temperatures; nothing is stored."""
    current = (await machine_in_memory(request, context, machine)).current
    warnings = database_warnings(context, current)
    table = table_at(current, body.temperatures_c, context.now(), warnings, body.state)
    return Written(table_json(table))


@_direct.get(
    "/compensation",
    summary="Compensation table at the latest reading",
    response_model=CurrentCompensationAnswer,
    responses={304: {"description": "Unchanged since the ETag in If-None-Match"}},
)
async def get_compensation(
    request: Request,
    context: ContextDep,
    machine: MachinePath,
    if_none_match: Annotated[str, Header(description="ETag of the table that is known")] = "",
) -> Response:
    """Compute the table at the latest reading, with every sensor's state.

    The ETag changes with the model, the reading and the sensors' states; while it
    does not, If-None-Match is answered with 304.
    """
    live = await machine_with_readings(request, context, machine)
    state = current_state(context, machine, live)
    headers = {"ETag": f'W/"{state.tag}"', "Cache-Control": "no-cache"}
    if _matches(if_none_match, state.tag):
        return Response(status_code=304, headers=headers)
    written = current_table_json(current_table(context, state))
    return Response(written, media_type=JSON, headers=headers)


def _matches(if_none_match: str, tag: str) -> bool:
    """Compare weakly (RFC 9110, 13.1.2)."""
    tags = {part.strip().removeprefix("W/") for part in if_none_match.split(",")}
    return f'"{tag}"' in tags or "*" in tags


router = Router(route_class=BodyRoute, prefix="/v1/machines/{machine}", tags=["live"])


@router.post(
    "/predictions", summary="Predict errors at given times", openapi_extra=body_of_at_most(32)
)
@needs(Role.VIEWER)
def post_predictions(
    context: ContextDep, machine: MachinePath, body: PredictionRequest
) -> Predictions:
    """Say what the model predicts, with the stored readings' temperatures at each time."""
    return predict_errors(
        context,
        machine,
        body.observations,
        body.model_version,
        missing_as_zero=body.missing_components == "zero",
    )


_status = Router(route_class=BodyRoute, prefix="/v1", tags=["live"])


@_status.get("/status", summary="Whether the machines can be trusted now")
def get_statuses(request: Request, context: ContextDep) -> list[MachineStatus]:
    """Give every machine's verdict, by id: what it rests on, why not, and how large it may be."""
    may_see = sees(request)
    return [status for status in show_statuses(context) if may_see(status.machine)]


@_status.get("/machines/{machine}/status", summary="Whether a machine can be trusted now")
def get_status(context: ContextDep, machine: MachinePath) -> MachineStatus:
    """Give one machine's verdict.

    Pages, streams and the command line repeat it word for word; it is judged here alone.
    """
    return show_status(context, machine)


router.routes.extend([*_direct.routes, *_status.routes])
