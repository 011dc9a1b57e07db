"""Files that come as a request's body, as they are.

What reads one is a dependency, which reads it `in_a_thread` and stands in the `read_first` of a
router with `FileRoute`s: however long that takes, nobody holds a turn at the database meanwhile.
"""

from __future__ import annotations

from typing import Annotated, Any, Final

from fastapi import Depends, Query, Request

from app.api.bodies import body_of_at_most
from app.api.media_types import CSV, XLSX

_LARGEST_MB: Final = 32
_TEXTS: Final = (CSV, "text/plain", "text/tab-separated-values")
_BINARY: Final = (XLSX, "application/vnd.ms-excel", "application/octet-stream")
"""By which programs call such files; Windows calls CSV the second. Readers look at the content."""

FILE_BODY: Final[dict[str, Any]] = body_of_at_most(_LARGEST_MB) | {
    "requestBody": {
        "required": True,
        "content": {
            **{kind: {"schema": {"type": "string"}} for kind in _TEXTS},
            **{kind: {"schema": {"type": "string", "format": "binary"}} for kind in _BINARY},
        },
    }
}


async def _file_content(request: Request) -> bytes:
    return await request.body()


FileContent = Annotated[bytes, Depends(_file_content)]
FileName = Annotated[
    str,
    Query(max_length=200, description="The file's name, for messages", examples=["run-9.csv"]),
]
