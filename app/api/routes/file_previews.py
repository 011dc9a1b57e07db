"""Files that are dropped on a page: what was read of them, before anything is stored."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from fastapi import Depends, Request

from app.api.bodies import FileRoute, in_a_thread
from app.api.dependencies import ContextDep, MachinePath
from app.api.files.file_kind import FileKind, OtherKind, kind_of_file
from app.api.files.uploaded_verification import UploadedVerification
from app.api.pages import Page, take_reader
from app.api.router import Router
from app.api.routes.map_files import BesideQuery, FoundMap, uploaded_map
from app.api.routes.verification_files import uploaded_verification
from app.api.uploads import FILE_BODY, FileContent, FileName
from app.errors import FieldError, InvalidContent
from app.pages.dashboard.loop import check_preview
from app.pages.dashboard.maps import upload_preview
from app.services.error_maps import preview_error_map


@dataclass(frozen=True, slots=True, eq=False)
class _Read:
    """What a file was read as, and the other kind that it looks like, if any."""

    found: FoundMap | UploadedVerification
    kind: FileKind
    looks_like: FileKind | None


async def uploaded_file(
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


router = Router(route_class=FileRoute, read_first=uploaded_file, include_in_schema=False)


@router.post("/machines/{machine}/files/preview", response_class=Page, openapi_extra=FILE_BODY)
def post_file_preview(
    context: ContextDep,
    machine: MachinePath,
    read: Annotated[_Read, Depends(uploaded_file)],
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
