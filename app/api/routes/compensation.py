"""The live table, from memory."""

from __future__ import annotations

from typing import Annotated

from fastapi import Header, Request
from starlette.responses import Response

from app.access.keys import Role
from app.api.access import needs
from app.api.bodies import DirectRoute, Written
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

router = Router(route_class=DirectRoute, prefix="/v1/machines/{machine}", tags=["live"])


@router.post(
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


@router.get(
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
