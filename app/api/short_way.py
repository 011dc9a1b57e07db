"""The short way to the live table: a request that is plain goes past the framework.

Routing, dependencies, middlewares and models cost several times what the table
itself costs. A `POST …/compensation` that comes in one piece, for a machine in
memory, with content in order, is answered here. Everything else, and everything
that is wrong in any way, goes the ordinary way with what has been read of it, so
that there is one place for refusals and their words.

Sensors resolve a tenth or a hundredth of a degree, so the same request comes
again and again: but for its time, its answer is remembered.
"""

from __future__ import annotations

from datetime import UTC, datetime
from functools import lru_cache
from time import perf_counter

from fastapi import FastAPI
from pydantic import TypeAdapter, ValidationError
from starlette.types import Message, Receive, Scope, Send

from app.api.metrics import Metrics
from app.api.schemas.compensation import CompensationRequest
from app.api.table_json import table_json
from app.errors import ThermapError
from app.live.registry import LiveModel
from app.services.context import Context
from app.services.live_table import table_at

BEFORE = "/v1/machines/"
AFTER = "/compensation"
ROUTE = f"{BEFORE}{{machine}}{AFTER}"
JSON_HEADER = (b"content-type", b"application/json")

LARGEST_PLAIN_BODY = 4096
"""Longer bodies go the ordinary way [bytes]; some hundred sensors fit."""

REMEMBERED = 1024
"""Answers that are remembered, over all machines: some 15 MB."""

_SOME_TIME = datetime(1970, 1, 1, tzinfo=UTC)
_SOME_TIME_TEXT = b"1970-01-01T00:00:00Z"

_REQUEST = TypeAdapter(CompensationRequest)


class ThermapService(FastAPI):
    """The application; `state.context` and `state.metrics` are set by `create_app`."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a plain request for a table at once, any other the ordinary way."""
        if not _may_be_plain(scope):
            await super().__call__(scope, receive, send)
            return
        started = perf_counter()
        message = await receive()
        content = plain_answer(self.state.context, scope, message)
        if content is None:
            await super().__call__(scope, _again(message, receive), send)
            return
        headers = [JSON_HEADER, (b"content-length", b"%d" % len(content))]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        await send({"type": "http.response.body", "body": content})
        metrics: Metrics = self.state.metrics
        metrics.count(ROUTE, "POST", 200, perf_counter() - started)


def plain_answer(context: Context, scope: Scope, message: Message) -> bytes | None:
    """Write the table if the request is in order in every way, else None."""
    body = message.get("body", b"")
    if message.get("more_body", False) or len(body) > LARGEST_PLAIN_BODY:
        return None
    live = context.live.get(scope["path"][len(BEFORE) : -len(AFTER)])
    if live is None or context.live.database_away_since is not None:
        return None
    try:
        before, after = _around_time(live.current, body)
    except (ThermapError, ValidationError):
        return None
    return b"".join((before, context.now().strftime("%Y-%m-%dT%H:%M:%S.%fZ").encode(), after))


@lru_cache(maxsize=REMEMBERED)
def _around_time(current: LiveModel, body: bytes) -> tuple[bytes, bytes]:
    """Write the answer to a body: what comes before and after the time of computing."""
    stated = _REQUEST.validate_json(body)
    written = table_json(table_at(current, stated.temperatures_c, _SOME_TIME))
    before, _, after = written.partition(_SOME_TIME_TEXT)
    return before, after


def _may_be_plain(scope: Scope) -> bool:
    return (
        scope["type"] == "http"
        and scope["method"] == "POST"
        and scope["path"].endswith(AFTER)
        and scope["path"].startswith(BEFORE)
        and JSON_HEADER in scope["headers"]
    )


def _again(first: Message, receive: Receive) -> Receive:
    """Hand the first message out once more, then whatever follows."""
    waiting = [first]

    async def receive_again() -> Message:
        return waiting.pop() if waiting else await receive()

    return receive_again
