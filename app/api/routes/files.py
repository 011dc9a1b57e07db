"""Files of either kind: what one holds is recognised, and stored as what it is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final

from fastapi import Depends, Query, Request, Response

from app.api.bodies import FileRoute, in_a_thread
from app.api.dependencies import AcceptLossesQuery, ContextDep, MachinePath, PreviewQuery
from app.api.files.file_kind import FileKind, kind_of_file
from app.api.files.uploaded_verification import UploadedVerification
from app.api.router import Router
from app.api.routes.error_maps import answer_to_map
from app.api.routes.map_files import BesideQuery, FoundMap, uploaded_map
from app.api.routes.verification_files import uploaded_verification
from app.api.routes.verifications import answer_to_verification
from app.api.schemas.error_maps import ErrorMapAnswer
from app.api.schemas.model_change import PreviewAnswer
from app.api.schemas.verifications import StoredVerificationAnswer, VerificationPreview
from app.api.uploads import FILE_BODY, FileContent, FileName
from app.errors import FieldError, InvalidContent, list_names
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
    found: Annotated[FoundMap | UploadedVerification, Depends(_recognised)],
    response: Response,
    preview: PreviewQuery = False,
    accept_losses: AcceptLossesQuery = False,
) -> ImportedFile:
    """Store a file as `…/error-maps/from-file` or `…/verifications/from-file` does.

    Which of them it is for is recognised by its columns, or by the names in its JSON. The preview
    of check measurements says how they were read; whether tables change they do not decide.
    """
    if isinstance(found, FoundMap):
        return answer_to_map(
            context,
            machine,
            found.error_map,
            response,
            preview=preview,
            accept_losses=accept_losses,
            notes=found.remarks,
        )
    check = found.verification
    try:
        if not preview:
            return answer_to_verification(context, machine, check, response, found.remarks)
        check_verification(context, machine, check)
    except InvalidContent as error:
        raise found.refusal(error) from None
    response.status_code = 200
    return VerificationPreview.of(check, [*found.remarks, *check.remarks])
