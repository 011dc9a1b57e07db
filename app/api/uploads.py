"""Files that come as a request's body, as they are."""

from __future__ import annotations

from typing import Annotated, Any, Final

from fastapi import Depends, Query, Request
from starlette.exceptions import HTTPException

from app.api.bodies import MEGABYTE, body_of_at_most
from app.api.media_types import CSV

_LARGEST_MB: Final = 32
_KINDS: Final = (CSV, "application/octet-stream")

FILE_BODY: Final[dict[str, Any]] = body_of_at_most(_LARGEST_MB) | {
    "requestBody": {
        "required": True,
        "content": {
            CSV: {"schema": {"type": "string"}},
            _KINDS[1]: {"schema": {"type": "string", "format": "binary"}},
        },
    }
}


async def file_content(request: Request) -> bytes:
    """Receive a file; a browser sends these kinds for no other site's page."""
    got = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if got not in _KINDS:
        raise HTTPException(415, f"expected {' or '.join(_KINDS)}, got {got[:80] or 'nothing'}")
    most = min(_LARGEST_MB * MEGABYTE, request.app.state.max_body_bytes)
    found = bytearray()
    async for piece in request.stream():
        found += piece
        if len(found) > most:
            raise HTTPException(413, f"expected a file of at most {most} bytes")
    return bytes(found)


FileContent = Annotated[bytes, Depends(file_content)]
FileName = Annotated[
    str,
    Query(max_length=200, description="The file's name, for messages", examples=["run-9.csv"]),
]
