"""Files of error maps and of check measurements: read, shown as they were read, and stored."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

from fastapi import Depends, Query, Request, Response

from app.api.bodies import FileRoute, in_a_thread
from app.api.dependencies import AcceptLossesQuery, ContextDep, MachinePath, PreviewQuery
from app.api.pages import Page, take_reader
from app.api.router import Router
from app.api.routes.error_maps import answer_to_map
from app.api.routes.verifications import answer_to_verification
from app.api.schemas.error_maps import ErrorMapAnswer
from app.api.schemas.model_change import PreviewAnswer
from app.api.schemas.verifications import StoredVerificationAnswer, VerificationPreview
from app.api.uploaded_verification import UploadedVerification
from app.api.uploads import (
    FILE_BODY,
    BesideQuery,
    FileContent,
    FileName,
    FoundMap,
    uploaded_map,
    uploaded_verification,
)
from app.errors import FieldError, InvalidContent, list_names
from app.files.file_kind import FileKind, OtherKind, kind_of_file
from app.pages.dashboard.loop import check_preview
from app.pages.dashboard.maps import upload_preview
from app.services.error_maps import preview_error_map
from app.services.verifications import check_verification

ImportedFile = ErrorMapAnswer | StoredVerificationAnswer | PreviewAnswer | VerificationPreview

_NOTHING_NEW: Final[dict[int | str, dict[str, Any]]] = {
    200: {"model": ImportedFile, "description": "The preview; or what is stored already"}
}


async def _recognised(
    request: Request,
    context: ContextDep,
    machine: MachinePath,
    content: FileContent,
    beside: BesideQuery,
    name: FileName = "file.csv",
    kind: Annotated[
        FileKind | None,
        Query(description="What it holds, `map` or `check`, where the file itself does not say"),
    ] = None,
) -> FoundMap | UploadedVerification:
    """Read a file as what it is; what looks like neither is taken for a map, and refused as one."""
    kind = kind or await in_a_thread(lambda: kind_of_file(content, Path(name)))
    if kind is not FileKind.CHECK:
        return await uploaded_map(request, context, machine, content, beside, name)
    if beside.names:
        message = f"expected for a map alone, but {name} holds {kind.words}"
        wrong = [FieldError(field, message) for field in beside.names]
        raise InvalidContent(f"{list_names(beside.names)}: {message}", wrong)
    return await uploaded_verification(machine, content, name)


router = Router(route_class=FileRoute, read_first=_recognised, tags=["error maps"])


@router.post(
    "/v1/machines/{machine}/files",
    status_code=201,
    summary="Store what a file holds: an error map or check measurements",
    responses=_NOTHING_NEW,
    openapi_extra=FILE_BODY,
)
def post_file(
    context: ContextDep,
    machine: MachinePath,
    upload: Annotated[FoundMap | UploadedVerification, Depends(_recognised)],
    response: Response,
    preview: PreviewQuery = False,
    accept_losses: AcceptLossesQuery = False,
) -> ImportedFile:
    """Store an error map or check measurements: CSV, an Excel workbook, or JSON.

    Which of them it is, is recognised by its columns, or by the names in its JSON. A map may also
    be an instrument's own file (Renishaw's linear .rtl), or with `method` a table of readings that
    make one. What is wrong in it is answered with line and column, under `file`; what a map's file
    does not say under its own name, and is stated in the query. What is stated takes precedence
    over what the file says. Without a label check measurements are called as the file. What of the
    file was not read stands in `warnings`. All else is as with the same in JSON. The preview of
    check measurements says how they were read; whether tables change they do not decide.
    """
    if isinstance(upload, FoundMap):
        return answer_to_map(
            context,
            machine,
            upload.error_map,
            response,
            preview=preview,
            accept_losses=accept_losses,
            notes=upload.remarks,
        )
    check = upload.verification
    try:
        if not preview:
            return answer_to_verification(context, machine, check, response, upload.remarks)
        check_verification(context, machine, check)
    except InvalidContent as error:
        raise upload.refusal(error) from None
    response.status_code = 200
    return VerificationPreview.of(check, [*upload.remarks, *check.remarks])


@dataclass(frozen=True, slots=True, eq=False)
class _Read:
    """What a file was read as, and the other kind that it looks like, if any."""

    found: FoundMap | UploadedVerification
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

    async def read(kind: FileKind) -> FoundMap | UploadedVerification:
        if kind is FileKind.CHECK:
            return await uploaded_verification(machine, content, name)
        return await uploaded_map(request, context, machine, content, beside, name)

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
    if isinstance(found, FoundMap):
        part = upload_preview(
            preview_error_map(context, machine, found.error_map),
            name,
            found.error_map,
            found.remarks,
            found.method,
            found.figures,
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
