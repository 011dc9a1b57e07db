"""Controllers' files: formats, exports, and what a controller holds against what it should."""

from __future__ import annotations

import io
import zipfile
from typing import Annotated, Any, Final

from fastapi import Header, Path, Query
from pydantic import TypeAdapter
from starlette.responses import Response

from app.access.keys import Role
from app.api.access import needs
from app.api.bodies import BodyRoute, body_of_at_most
from app.api.dependencies import ContextDep, MachinePath
from app.api.media_types import JSON, ZIP
from app.api.negotiation import chosen_form
from app.api.router import Router
from app.services.controllers import (
    Compared,
    CompareRequest,
    DescribedFormats,
    Exported,
    ExportRequest,
    ParsedFiles,
    ParseRequest,
    compare_files,
    describe_formats,
    export_compensation,
    parse_files,
)

router = Router(route_class=BodyRoute, tags=["controllers"])

ANSWER_FILE = "thermap-answer.json"
"""What an answer says beside its files, in the zip."""

_EXPORTED: Final = TypeAdapter(Exported)

_ZIP: dict[int | str, dict[str, Any]] = {
    200: {"content": {ZIP: {"schema": {"type": "string", "format": "binary"}}}}
}

ControllerPath = Annotated[str, Path(description="Format", examples=["linuxcnc"])]
ControllerQuery = Annotated[
    str,
    Query(
        max_length=100,
        description="Format, one of `GET /v1/controllers`",
        examples=["linuxcnc"],
    ),
]


@router.get("/v1/controllers", summary="List the controllers' file formats")
def get_controllers() -> DescribedFormats:
    """List every format with its sign, units, limits, options, and how surely it is known."""
    return describe_formats()


@router.post(
    "/v1/machines/{machine}/compensation/export",
    summary="Compensation as a controller's files",
    response_model=Exported,
    responses=_ZIP,
)
@needs(Role.VIEWER)
def post_export(
    context: ContextDep,
    machine: MachinePath,
    controller: ControllerQuery,
    body: ExportRequest,
    accept: Annotated[str, Header(description=f"`{JSON}` or `{ZIP}`")] = JSON,
) -> Response:
    """Write the files at stated temperatures or at the latest reading; nothing is stored.

    The answer says what the controller cannot hold and how large that is, what spacing and
    rounding add, and which moves show whether the sign is right. As a zip it has the same in
    `thermap-answer.json`.
    """
    exported = export_compensation(context, machine, controller, body)
    if chosen_form(accept, [JSON, ZIP]) == ZIP:
        return Response(_zip(exported), media_type=ZIP, headers={"Vary": "Accept"})
    written = _EXPORTED.dump_json(exported)
    return Response(written, media_type=JSON, headers={"Vary": "Accept"})


@router.post(
    "/v1/machines/{machine}/compensation/compare",
    summary="What a controller holds against what it should hold",
    openapi_extra=body_of_at_most(32),
)
@needs(Role.VIEWER)
def post_compare(
    context: ContextDep, machine: MachinePath, controller: ControllerQuery, body: CompareRequest
) -> Compared:
    """Compare a controller's files with the table: forgotten, stale and foreign compensation."""
    return compare_files(context, machine, controller, body)


@router.post(
    "/v1/controllers/{controller}/parse",
    summary="Read a controller's files",
    openapi_extra=body_of_at_most(32),
)
@needs(Role.VIEWER)
def post_parse(controller: ControllerPath, body: ParseRequest) -> ParsedFiles:
    """Say what files hold, in our sign and units; what would be read wrongly is refused."""
    return parse_files(controller, body.files, body.options)


def _zip(answer: Exported) -> bytes:
    """Pack the files; their time is that of the answer, so that the same answer is the same zip."""
    packed = io.BytesIO()
    at = answer.computed_at
    date = (max(at.year, 1980), at.month, at.day, at.hour, at.minute, at.second)
    head = _EXPORTED.dump_json(
        answer, indent=2, exclude={"files": {"__all__": {"content"}}}
    ).decode()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in [*((f.name, f.content) for f in answer.files), (ANSWER_FILE, head)]:
            archive.writestr(zipfile.ZipInfo(name, date), content)
    return packed.getvalue()
