"""Error maps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from fastapi import Response

from app.api.bodies import BodyRoute, body_of_at_most
from app.api.dependencies import (
    AcceptLossesQuery,
    ContextDep,
    MachinePath,
    MapPath,
    PreviewQuery,
)
from app.api.router import Router
from app.services.context import Context
from app.services.error_maps import (
    ErrorMapAnswer,
    map_answer,
    preview_error_map,
    preview_withdrawal,
    store_error_map,
    withdraw_map,
)
from app.services.machines import show_error_map, show_error_maps
from app.services.models import Preview
from app.thermal.error_map import ErrorMap

router = Router(
    route_class=BodyRoute, prefix="/v1/machines/{machine}/error-maps", tags=["error maps"]
)

NOTHING_NEW: Final[dict[int | str, dict[str, Any]]] = {
    200: {
        "model": ErrorMapAnswer | Preview,
        "description": "The preview; or the map, which is stored already",
    }
}
"""What a map that is sent is answered with where nothing new is stored."""


@router.post(
    "",
    status_code=201,
    summary="Store an error map",
    response_model_exclude_none=True,
    responses=NOTHING_NEW,
    openapi_extra=body_of_at_most(32),
)
def post_error_map(
    context: ContextDep,
    machine: MachinePath,
    body: ErrorMap,
    response: Response,
    preview: PreviewQuery = False,
    accept_losses: AcceptLossesQuery = False,
) -> ErrorMapAnswer | Preview:
    """Store a map measured in one thermal state; this makes the next model version.

    A version whose tables would lose something against the active one is stored and waits: the
    answer says what is lost, and how to activate it all the same. The same content under the
    same label again answers 200 with the stored map. A preview answers 200 too.
    """
    if preview:
        response.status_code = 200
        return preview_error_map(context, machine, body)
    return store_map(context, machine, body, response, accept_losses=accept_losses)


@router.get("", summary="List error maps", response_model_exclude_none=True)
def get_error_maps(context: ContextDep, machine: MachinePath) -> list[ErrorMapAnswer]:
    """List a machine's maps in the order in which they were stored."""
    maps, active = show_error_maps(context, machine)
    return [map_answer(m, m.id in active) for m in maps]


@router.get("/{map_id}", summary="Show an error map", response_model_exclude_none=True)
def get_error_map(context: ContextDep, machine: MachinePath, map_id: MapPath) -> ErrorMapAnswer:
    """Show one map."""
    stored, in_active_model = show_error_map(context, machine, map_id)
    return map_answer(stored, in_active_model)


@router.delete(
    "/{map_id}",
    summary="Delete an error map",
    response_model=Preview,
    responses={204: {"description": "It is out of use"}, 200: {"description": "The preview"}},
)
def delete_error_map(
    context: ContextDep, machine: MachinePath, map_id: MapPath, preview: PreviewQuery = False
) -> Preview | Response:
    """Take a map out of use: the next model version is without it, older ones keep it.

    It is active whatever its tables lose; a preview says before what that would be.
    """
    if preview:
        return preview_withdrawal(context, machine, map_id)
    withdraw_map(context, machine, map_id)
    return Response(status_code=204)


def store_map(
    context: Context,
    machine: str,
    error_map: ErrorMap,
    response: Response,
    *,
    accept_losses: bool,
    notes: Sequence[str] = (),
) -> ErrorMapAnswer:
    """Store a map, whichever way it came; `notes` are of its file."""
    outcome = store_error_map(context, machine, error_map, accept_losses=accept_losses)
    response.status_code = 201 if outcome.is_new else 200
    response.headers["Location"] = f"/v1/machines/{machine}/error-maps/{outcome.stored.id}"
    warnings = [*notes, *outcome.remarks]
    # A map that costs nothing is answered as it is shown, now and later.
    made = outcome.made
    change = made.change if made and made.change.loses else None
    return map_answer(outcome.stored, outcome.in_active_model, warnings, change)
