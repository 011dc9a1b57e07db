"""Error maps from files: as the API takes them, and as the dashboard shows them before."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated

from fastapi import APIRouter, Query, Response

from app.api.dependencies import AcceptLossesQuery, ContextDep, MachinePath, PreviewQuery
from app.api.files.csv_comments import Stated
from app.api.files.uploaded_map import read_uploaded_map
from app.api.pages import Page
from app.api.routes.error_maps import NOTHING_NEW, answer_to_map
from app.api.schemas.error_maps import ErrorMapAnswer
from app.api.schemas.model_change import PreviewAnswer
from app.api.uploads import FILE_BODY, FileContent, FileName
from app.pages.dashboard.maps import upload_preview
from app.services.error_maps import preview_error_map

router = APIRouter(tags=["error maps"])


@router.post(
    "/v1/machines/{machine}/error-maps/from-file",
    status_code=201,
    summary="Store an error map from a file",
    response_model_exclude_none=True,
    responses=NOTHING_NEW,
    openapi_extra=FILE_BODY,
)
def post_map_file(
    context: ContextDep,
    machine: MachinePath,
    content: FileContent,
    response: Response,
    name: FileName = "file.csv",
    label: Annotated[
        str | None, Query(max_length=200, description="The map's name, where the file has none")
    ] = None,
    measured_at: Annotated[
        datetime | None, Query(description="When it was measured, ISO 8601 with its zone")
    ] = None,
    preview: PreviewQuery = False,
    accept_losses: AcceptLossesQuery = False,
) -> ErrorMapAnswer | PreviewAnswer:
    """Store a map that stands in a CSV file or an Excel workbook, as `thermap import` reads it.

    What is wrong in it is answered with line and column. Label and time that are stated take
    precedence over those in the file. All else is as with an error map in JSON.
    """
    stated = Stated(label, None if measured_at is None else measured_at.isoformat())
    found = read_uploaded_map(content, name, machine, stated)
    return answer_to_map(
        context,
        machine,
        found.error_map.to_error_map(),
        response,
        preview=preview,
        accept_losses=accept_losses,
        notes=found.remarks,
    )


@router.post("/machines/{machine}/maps/preview", response_class=Page, include_in_schema=False)
def post_upload_preview(
    context: ContextDep, machine: MachinePath, content: FileContent, name: FileName = "file.csv"
) -> Page:
    """Show what storing a file's map would do, as a part of the page of maps."""
    found = read_uploaded_map(content, name, machine, Stated())
    error_map = found.error_map.to_error_map()
    preview = preview_error_map(context, machine, error_map)
    shown = upload_preview(preview, name, error_map, found.remarks)
    return Page(shown, scripts=0, headers={"Cache-Control": "no-store"})
