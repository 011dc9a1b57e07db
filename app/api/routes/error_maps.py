"""Error maps."""

from __future__ import annotations

from fastapi import APIRouter, Response

from app.api.dependencies import ContextDep, MachinePath, MapPath
from app.api.schemas.error_maps import ErrorMapAnswer, ErrorMapSchema
from app.services.show_machines import show_error_map, show_error_maps
from app.services.store_error_map import remarks, store_error_map
from app.services.withdraw_error_map import withdraw_map

router = APIRouter(prefix="/v1/machines/{machine}/error-maps", tags=["error maps"])


@router.post("", status_code=201, summary="Store an error map", response_model_exclude_none=True)
def post_error_map(
    context: ContextDep, machine: MachinePath, body: ErrorMapSchema, response: Response
) -> ErrorMapAnswer:
    """Store a map measured in one thermal state; this makes the next model version.

    The same content under the same label again answers 200 with the stored map.
    """
    found = store_error_map(context, machine, body.to_error_map())
    response.status_code = 201 if found.is_new else 200
    response.headers["Location"] = f"/v1/machines/{machine}/error-maps/{found.stored.id}"
    warnings = remarks(found.machine, found.stored.error_map)
    return ErrorMapAnswer.of(found.stored, found.in_active_model, warnings)


@router.get("", summary="List error maps", response_model_exclude_none=True)
def get_error_maps(context: ContextDep, machine: MachinePath) -> list[ErrorMapAnswer]:
    """List a machine's maps in the order in which they were stored."""
    maps, active = show_error_maps(context, machine)
    return [ErrorMapAnswer.of(m, m.id in active, []) for m in maps]


@router.get("/{map_id}", summary="Show an error map", response_model_exclude_none=True)
def get_error_map(context: ContextDep, machine: MachinePath, map_id: MapPath) -> ErrorMapAnswer:
    """Show one map."""
    stored, in_active_model = show_error_map(context, machine, map_id)
    return ErrorMapAnswer.of(stored, in_active_model, [])


@router.delete("/{map_id}", status_code=204, summary="Delete an error map")
def delete_error_map(context: ContextDep, machine: MachinePath, map_id: MapPath) -> None:
    """Take a map out of use: the next model version is without it, older ones keep it."""
    withdraw_map(context, machine, map_id)
