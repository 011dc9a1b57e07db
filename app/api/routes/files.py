"""Files of error maps and of check measurements: read, shown as they were read, and stored."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Union

from fastapi import Depends, Query, Request, Response

from app.answer import fields_of
from app.api.bodies import FileRoute, in_a_thread
from app.api.dependencies import ContextDep, MachinePath
from app.api.methods.registry import METHODS
from app.api.methods.shapes import MeasurementAnswer
from app.api.pages import Page, take_reader
from app.api.router import Router
from app.api.routes.error_maps import store_map
from app.api.routes.verifications import answer_to_verification
from app.api.schemas.analyses import PlannedVerification, VisitPreview
from app.api.schemas.error_maps import ErrorMapAnswer, MapPreview
from app.api.schemas.verifications import StoredVerificationAnswer, VerificationPreview
from app.api.uploaded_verification import UploadedVerification
from app.api.uploads import (
    FILE_BODY,
    BesideQuery,
    FileContent,
    FileName,
    FoundMap,
    FoundReadings,
    StoringQuery,
    refuse_what_readings_have,
    uploaded_map,
    uploaded_verification,
)
from app.errors import FieldError, InvalidContent, list_names
from app.files.file_kind import FileKind, OtherKind, kind_of_file
from app.pages.dashboard.loop import check_preview
from app.pages.dashboard.maps import upload_preview
from app.pages.what_was_read import read_of_map, read_of_verification
from app.services.context import Context
from app.services.error_maps import preview_error_map
from app.services.measurements import Storing, measured_machine
from app.services.verifications import check_places, check_verification

PlannedQuery = Annotated[
    bool,
    Query(
        description="Whether check measurements are yet to be made: they need no values, and a "
        "preview gives them as `…/analyses/plan` takes them"
    ),
]
Found = FoundMap | FoundReadings | UploadedVerification

ImportedFile = (
    ErrorMapAnswer | StoredVerificationAnswer | MapPreview | VerificationPreview | VisitPreview
)
_ANSWER: Any = Union[ImportedFile, *(method.answer for method in METHODS.values())]

_NOTHING_NEW: Final[dict[int | str, dict[str, Any]]] = {
    200: {"model": _ANSWER, "description": "The preview; or what is stored already"}
}


async def _recognised(
    request: Request,
    context: ContextDep,
    machine: MachinePath,
    content: FileContent,
    beside: BesideQuery,
    storing: StoringQuery,
    name: FileName = "file.csv",
    kind: Annotated[
        FileKind | None,
        Query(description="What it holds, `map` or `check`, where the file itself does not say"),
    ] = None,
    planned: PlannedQuery = False,
) -> Found:
    """Read a file as what it is; what looks like neither is taken for a map, and refused as one."""
    if planned:
        kind = FileKind.CHECK
        if storing.store and not storing.preview:
            raise InvalidContent.of_field(
                "planned", "expected with `preview`: what is yet to be measured cannot be stored"
            )
    kind = kind or await in_a_thread(lambda: kind_of_file(content, Path(name)))
    if kind is not FileKind.CHECK:
        found = await uploaded_map(request, context, machine, content, beside, storing, name)
        if isinstance(found, FoundMap):
            refuse_what_readings_have(name, beside, storing)
        return found
    if beside.names:
        message = f"expected for a map alone, but {name} holds {kind.words}"
        wrong = [FieldError(field, message) for field in beside.names]
        raise InvalidContent(f"{list_names(beside.names)}: {message}", wrong)
    return await uploaded_verification(machine, content, name, is_planned=planned)


router = Router(route_class=FileRoute, read_first=_recognised, tags=["error maps"])


@router.post(
    "/v1/machines/{machine}/files",
    status_code=201,
    summary="Store what a file holds: an error map, an instrument's readings or check measurements",
    response_model=_ANSWER,
    responses=_NOTHING_NEW,
    openapi_extra=FILE_BODY,
)
def post_file(
    context: ContextDep,
    machine: MachinePath,
    upload: Annotated[Found, Depends(_recognised)],
    storing: StoringQuery,
    response: Response,
    planned: PlannedQuery = False,
) -> ImportedFile | MeasurementAnswer:
    """Store an error map or check measurements: CSV, an Excel workbook, or JSON.

    Which of them it is, is recognised by its columns, or by the names in its JSON. A map may also
    be an instrument's own file (Renishaw's linear .rtl), or with `method` a table of readings that
    make one: they are answered as `…/measurements/{method}` answers. What is wrong in a file is
    answered with line and column, under `file`; what a map's file does not say under its own name,
    and is stated in the query. What is stated takes precedence over what the file says. Without a
    label check measurements are called as the file. What of the file was not read stands in
    `warnings`. All else is as with the same in JSON. A preview says how the file was read; whether
    tables change check measurements do not decide.
    """
    if isinstance(upload, FoundMap):
        return _answer_to_map(context, machine, upload, storing, response)
    if isinstance(upload, FoundReadings):
        return _answer_to_readings(context, upload, storing, response)
    check = upload.verification
    try:
        if planned:
            check_places(measured_machine(context, machine), check.observations)
        elif storing.preview:
            check_verification(context, machine, check)
        else:
            return answer_to_verification(context, machine, check, response, upload.remarks)
    except InvalidContent as error:
        raise upload.refusal(error) from None
    response.status_code = 200
    if planned:
        visit = PlannedVerification.model_validate(upload.body)
        return VisitPreview(planned=visit, warnings=[*upload.remarks, *check.remarks])
    read = list(read_of_verification(check).lines())
    return VerificationPreview.of(check, [*upload.remarks, *check.remarks], read)


def _answer_to_map(
    context: Context, machine: str, found: FoundMap, storing: Storing, response: Response
) -> ErrorMapAnswer | MapPreview:
    error_map, notes = found.error_map, found.remarks
    if not storing.preview:
        return store_map(
            context,
            machine,
            error_map,
            response,
            accept_losses=storing.accept_losses,
            notes=notes,
        )
    response.status_code = 200
    previewed = preview_error_map(context, machine, error_map)
    fields = fields_of(previewed) | {"warnings": [*notes, *previewed.warnings]}
    return MapPreview(
        **fields,
        label=error_map.label,
        components=list(error_map.tables),
        read=list(read_of_map(error_map).lines()),
    )


def _answer_to_readings(
    context: Context, found: FoundReadings, storing: Storing, response: Response
) -> MeasurementAnswer:
    method = found.method
    answer = method.store(method, context, found.machine, found.body, found.evaluated, storing)
    if answer.map_id is not None:
        machine = found.machine.id
        response.headers["Location"] = f"/v1/machines/{machine}/error-maps/{answer.map_id}"
    if not answer.is_new:
        response.status_code = 200
    return answer.model_copy(update={"warnings": list(found.remarks)})


@dataclass(frozen=True, slots=True, eq=False)
class _Read:
    """What a file was read as, and the other kind that it looks like, if any."""

    found: Found
    kind: FileKind
    looks_like: FileKind | None


async def _as_expected(
    request: Request,
    context: ContextDep,
    machine: MachinePath,
    content: FileContent,
    beside: BesideQuery,
    expected: FileKind = FileKind.MAP,
    name: FileName = "file.csv",
) -> _Read:
    """Read what came as the kind that is expected, or else as the one that it is."""
    take_reader(request)

    async def read(kind: FileKind) -> Found:
        if kind is FileKind.CHECK:
            return await uploaded_verification(machine, content, name)
        as_map = Storing(preview=True)
        return await uploaded_map(request, context, machine, content, beside, as_map, name)

    try:
        found = await read(expected)
    except OtherKind as other:
        kind = other.kind
    else:
        looks_like = await in_a_thread(lambda: kind_of_file(content, Path(name)))
        return _Read(found, expected, None if looks_like is expected else looks_like)
    try:
        return _Read(await read(kind), kind, None)
    except InvalidContent as error:
        said = FieldError("file", f"{name} holds {kind.words}")
        raise InvalidContent(error.detail, [said, *error.errors]) from None


previews = Router(route_class=FileRoute, read_first=_as_expected, include_in_schema=False)


@previews.post("/machines/{machine}/files/preview", response_class=Page, openapi_extra=FILE_BODY)
def post_file_preview(
    context: ContextDep,
    machine: MachinePath,
    read: Annotated[_Read, Depends(_as_expected)],
    expected: FileKind = FileKind.MAP,
    name: FileName = "file.csv",
) -> Page:
    """Show what was read of a file and what storing it would do, as a part of a page."""
    found = read.found
    is_expected, looks_like = read.kind is expected, read.looks_like or ""
    if not isinstance(found, UploadedVerification):
        readings = found if isinstance(found, FoundReadings) else None
        found = found.as_map() if isinstance(found, FoundReadings) else found
        part = upload_preview(
            preview_error_map(context, machine, found.error_map),
            name,
            found.error_map,
            found.remarks,
            readings.method.name if readings else None,
            readings.evaluated.result.figures if readings else {},
            is_expected=is_expected,
            looks_like=looks_like,
        )
    else:
        check = found.verification
        part = check_preview(
            check,
            name,
            [*found.remarks, *check.remarks],
            is_expected=is_expected,
            looks_like=looks_like,
        )
    return Page(part, scripts=0, headers={"Cache-Control": "no-store"})


router.routes.extend(previews.routes)
