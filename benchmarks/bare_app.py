"""The floor: a bare ASGI application that reads the body and returns the same bytes."""

from __future__ import annotations

import os
from pathlib import Path

BODY = Path(os.environ["BENCHMARK_BODY"]).read_bytes()
START = {
    "type": "http.response.start",
    "status": 200,
    "headers": [
        (b"content-type", b"application/json"),
        (b"content-length", str(len(BODY)).encode()),
    ],
}
ANSWER = {"type": "http.response.body", "body": BODY}


async def app(scope, receive, send):
    """Answer every request with the same bytes."""
    if scope["type"] != "http":
        return
    more = True
    while more:
        more = (await receive()).get("more_body", False)
    await send(START)
    await send(ANSWER)
