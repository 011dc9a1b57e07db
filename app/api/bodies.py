"""Reading a request's body: what kind it is, how long it may be, and what it must say.

Every route with a body reads it here, whether it is short or has a million points. Its bytes
are counted while they come, against the route's own limit. A long body is read and checked in
a thread, in pieces (`json_text`, `InPieces`): the live table waits for none of them longer
than for a piece.
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Sequence
from contextlib import AbstractAsyncContextManager, nullcontext
from functools import cache
from typing import Annotated, Any, Final, TypeVar, cast

from anyio import CapacityLimiter, to_thread
from anyio.lowlevel import RunVar
from fastapi import Request
from fastapi.exceptions import RequestValidationError
from fastapi.routing import APIRoute
from pydantic import TypeAdapter, ValidationError
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.responses import Response
from starlette.types import Message

from app.api.access import AccessControl, holder_of
from app.api.collector import uncollected
from app.api.dependencies import refuse_unknown_query
from app.api.field_errors import with_known_fields
from app.api.json_text import SHORT_TEXT, NoJsonError, RepeatedNameError, read_json
from app.api.long_bodies import AT_ONCE, LongBodies
from app.api.media_types import JSON
from app.api.schemas.base import Schema
from app.api.schemas.in_pieces import shown_errors
from app.api.turns import Turns
from app.errors import InvalidContent

MEGABYTE: Final = 1024 * 1024

USUAL_LIMIT: Final = 8 * MEGABYTE
"""Of routes that do not state their own [bytes]; what the operator sets holds for all."""

LIMIT_NAME: Final = "x-largest-body-bytes"
"""Under which a route's limit stands in the OpenAPI document."""

_THREADS: Final = 2 * AT_ONCE
"""Half of them for what is no long body, and takes long all the same."""

_MANY_OBJECTS: Final = MEGABYTE
_limiters: RunVar[CapacityLimiter] = RunVar("long bodies")

Handler = Callable[[Request], Coroutine[Any, Any, Response]]
Read = TypeVar("Read")


def body_of_at_most(megabytes: int) -> dict[str, Any]:
    """State a route's largest body, as part of what is documented of it."""
    return {LIMIT_NAME: megabytes * MEGABYTE}


class BodyRoute(APIRoute):
    """A route that reads its body as this file has it; one without a body wants none."""

    def get_route_handler(self) -> Handler:
        """Wrap the framework's handler, which is given what the body says, read and checked."""
        handle = super().get_route_handler()
        field = self.body_field
        if field is None:
            return _without_body(handle)
        stated = field.field_info
        adapter: TypeAdapter[Any] = TypeAdapter(cast("Any", Annotated[stated.annotation, stated]))
        limit = int((self.openapi_extra or {}).get(LIMIT_NAME, USUAL_LIMIT))

        async def read_and_handle(request: Request) -> Response:
            most = min(limit, request.app.state.max_body_bytes)
            body = await received(request, most)
            if not body:
                return await handle(ReadRequest(request, b"", None))
            _refuse_other_kinds(request, (JSON,))
            is_long = len(body) > SHORT_TEXT
            async with _turn(request) if is_long else nullcontext():
                with uncollected() if len(body) > _MANY_OBJECTS else nullcontext():
                    content = await _off_the_loop(len(body), lambda: _checked(adapter, body))
                    read = ReadRequest(request, body, content)
                    del content  # now `read` alone holds it, and `release` frees it
                    try:
                        return await self.answer(read, handle)
                    finally:
                        read.release()

        return read_and_handle

    async def answer(self, request: ReadRequest, handle: Handler) -> Response:
        """Answer a request of which the body has been read: by the framework."""
        return await handle(request)


class DirectRoute(BodyRoute):
    """A route that is handed the context, the machine of its path and its body, and nothing else.

    Its function is called without the framework between, whose dependencies, fields and models of
    the answer take longer than to read a hundred readings. What is refused, and in which words, is
    the same: there is no other way to this function.
    """

    async def answer(self, request: ReadRequest, handle: Handler) -> Response:
        """Answer it by calling the function, when it is our turn, in a thread."""
        await refuse_unknown_query(request)
        turns: Turns = request.app.state.turns
        machine = request.path_params["machine"]
        async with turns.taken():
            answer: Schema = await run_in_threadpool(
                self.endpoint, request.app.state.context, machine, request.content
            )
        return Response(
            answer.model_dump_json(exclude_defaults=self.response_model_exclude_defaults),
            status_code=self.status_code or 200,
            media_type=JSON,
        )


class FileRoute(APIRoute):
    """A route whose body is a file; its limit and kinds are those that are documented of it."""

    def get_route_handler(self) -> Handler:
        """Wrap the framework's handler, which is given a request whose file has come."""
        handle = super().get_route_handler()
        stated = self.openapi_extra or {}
        limit, kinds = int(stated[LIMIT_NAME]), tuple(stated["requestBody"]["content"])

        async def receive_and_handle(request: Request) -> Response:
            _refuse_other_kinds(request, kinds)
            body = await received(request, min(limit, request.app.state.max_body_bytes))
            # A file may be packed: its length does not say how long it takes.
            async with _turn(request):
                with uncollected() if len(body) > _MANY_OBJECTS else nullcontext():
                    return await handle(ReadRequest(request, body, None))

        return receive_and_handle


class ReadRequest(Request):
    """A request whose body has been read: the framework is handed what it said."""

    def __init__(self, request: Request, body: bytes, content: Any) -> None:
        super().__init__(request.scope, request.receive)
        self._came = body
        self.content = content

    async def body(self) -> bytes:
        """Give what came; nothing more will."""
        return self._came

    async def json(self) -> Any:
        """Give what it said."""
        return self.content

    def release(self) -> None:
        """Forget what it said: the framework holds requests for longer than their answers."""
        self.content = None


def _without_body(handle: Handler) -> Handler:
    async def refuse_body(request: Request) -> Response:
        stated = request.headers.get("content-length", "0")
        if stated.strip("0") or "transfer-encoding" in request.headers:
            raise InvalidContent.of_field(
                "body", f"expected no body for {request.method} {request.url.path}, got one"
            )
        return await handle(request)

    return refuse_body


async def received(request: Request, most: int) -> bytes:
    """Receive a body of at most so many bytes, or refuse it as soon as it is longer.

    Raises
    ------
    AccessRefused
        If the key of the request was revoked while it came.
    """
    stated = request.headers.get("content-length", "")
    too_large = HTTPException(413, f"expected a body of at most {most} bytes; send it in parts")
    # A header of many digits must not cost time: twenty are more than any limit. What it states
    # may also be untrue, so that what comes is counted all the same.
    if stated.isascii() and stated.isdecimal() and int(stated[:20]) > most:
        raise too_large
    got = bytearray()
    more = True
    while more:
        message: Message = await request.receive()
        if message["type"] != "http.request":
            raise HTTPException(408, "expected the rest of the body, but the connection ended")
        got += message.get("body", b"")
        if len(got) > most:
            raise too_large
        more = message.get("more_body", False)
    access: AccessControl = request.app.state.access
    access.confirm_request(request.scope)  # the body may have been long on its way
    return bytes(got)


def _refuse_other_kinds(request: Request, kinds: Sequence[str]) -> None:
    """Refuse what is of none of these kinds; a browser sends them for no other site's page."""
    got = request.headers.get("content-type", "")
    if got.partition(";")[0].strip().lower() not in kinds:
        expected = "JSON with the header" if JSON in kinds else "a file with the header"
        raise HTTPException(
            415,
            f"expected {expected} Content-Type: {' or '.join(kinds)}, got "
            f"{got[:80] or 'no Content-Type'}",
        )


def _turn(request: Request) -> AbstractAsyncContextManager[None]:
    """Give what waits for the turn of a long body."""
    turns: LongBodies = request.app.state.long_bodies
    return turns.taken(holder_of(request.scope))


async def _off_the_loop(size: int, read: Callable[[], Read]) -> Read:
    """Read a short body at once, a long one in a thread."""
    return read() if size <= SHORT_TEXT else await in_a_thread(read)


async def in_a_thread(read: Callable[[], Read]) -> Read:
    """Read what may be long in a thread, without the collector.

    The threads are not those of other requests: where these all wait, it is read nevertheless.
    """
    limiter = _limiters.get(None)
    if limiter is None:
        limiter = CapacityLimiter(_THREADS)
        _limiters.set(limiter)

    def read_uncollected() -> Read:
        with uncollected():
            return read()

    return await to_thread.run_sync(read_uncollected, limiter=limiter)


@cache
def _schema_of(adapter: TypeAdapter[Any]) -> dict[str, Any]:
    return adapter.json_schema()


def _checked(adapter: TypeAdapter[Any], body: bytes) -> Any:
    try:
        content = read_json(body)
    except NoJsonError as error:
        raise RequestValidationError(
            [{"type": "json_invalid", "loc": ("body",), "msg": "", "ctx": {"error": str(error)}}]
        ) from None
    except RepeatedNameError as error:
        raise InvalidContent.of_field(
            error.name, f"expected each name once in an object, got {error.name!r} twice"
        ) from None
    try:
        return adapter.validate_python(content)
    except ValidationError as error:
        wrong = shown_errors(error)
        if any(e["type"] == "extra_forbidden" for e in wrong):
            wrong = with_known_fields(wrong, _schema_of(adapter))
        found = [{**e, "loc": ("body", *e["loc"])} for e in wrong]
        raise RequestValidationError(found) from None
