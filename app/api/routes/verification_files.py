"""Verifications from files."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Response

from app.api.bodies import FileRoute, in_a_thread
from app.api.dependencies import ContextDep, MachinePath
from app.api.files.uploaded_verification import (
    UploadedVerification,
    read_uploaded_verification,
)
from app.api.router import Router
from app.api.routes.verifications import NOTHING_NEW, answer_to_verification
from app.api.schemas.verifications import StoredVerificationAnswer
from app.api.uploads import FILE_BODY, FileContent, FileName
from app.errors import InvalidContent


async def uploaded_verification(
    machine: MachinePath, content: FileContent, name: FileName = "file.csv"
) -> UploadedVerification:
    """Read the verification that came."""
    return await in_a_thread(lambda: read_uploaded_verification(content, name, machine))


router = Router(route_class=FileRoute, read_first=uploaded_verification, tags=["closing the loop"])


@router.post(
    "/v1/machines/{machine}/verifications/from-file",
    status_code=201,
    summary="Store a verification from a file",
    responses=NOTHING_NEW,
    openapi_extra=FILE_BODY,
)
def post_verification_file(
    context: ContextDep,
    machine: MachinePath,
    found: Annotated[UploadedVerification, Depends(uploaded_verification)],
    response: Response,
) -> StoredVerificationAnswer:
    """Store a verification from CSV, an Excel workbook or JSON, as `thermap analyse` reads it.

    What is wrong in it is answered with line and column. Without a label in it the verification
    is called as the file. What of the file was not read stands in `warnings`. All else is as with
    a verification in JSON.
    """
    try:
        return answer_to_verification(context, machine, found.verification, response, found.remarks)
    except InvalidContent as error:
        raise found.refusal(error) from None
