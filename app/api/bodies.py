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
from starlette.exceptions import HTTPException
from starlette.responses import Response
from starlette.types import Message, Receive, Scope, Send

from app.api.access import AccessControl, holder_of
from app.api.collector import uncollected
from app.api.dependencies import refuse_unknown_query
from app.api.long_bodies import AT_ONCE, LongBodies
from app.api.media_types import JSON
from app.errors import InvalidContent
from app.field_errors import UNKNOWN, with_known_fields
from app.in_pieces import shown_errors
from app.json_text import SHORT_TEXT, NoJsonError, RepeatedNameError, read_json

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
            return self._without_body(handle)
        field_info = field.field_info
        adapter: TypeAdapter[Any] = TypeAdapter(
            cast("Any", Annotated[field_info.annotation, field_info])
        )
        limit = int((self.openapi_extra or {}).get(LIMIT_NAME, USUAL_LIMIT))

        async def read_and_handle(request: Request) -> Response:
            body = await received(request, min(limit, request.app.state.max_body_bytes))
            if not body:
                return await self.answer(request, b"", None, handle)
            _refuse_other_kinds(request, (JSON,))
            if len(body) <= SHORT_TEXT:
                return await self.answer(request, body, _checked(adapter, body), handle)
            async with _turn(request):
                with uncollected() if len(body) > _MANY_OBJECTS else nullcontext():
                    # No name holds what it said: it is gone before the collector is back.
                    return await self.answer(
                        request, body, await in_a_thread(lambda: _checked(adapter, body)), handle
                    )

        return read_and_handle

    def _without_body(self, handle: Handler) -> Handler:
        async def refuse_body(request: Request) -> Response:
            length, _ = stated_of_body(request.scope)
            if length.strip(b"0") or "transfer-encoding" in request.headers:
                raise InvalidContent.of_field(
                    "body", f"expected no body for {request.method} {request.url.path}, got one"
                )
            return await self.answer(request, b"", None, handle)

        return refuse_body

    async def answer(
        self, request: Request, body: bytes, content: Any, handle: Handler
    ) -> Response:
        """Answer a request by the framework, given its body as it came, and what that says."""
        read = ReadRequest(request, body, content)
        del content  # now `read` alone holds it
        try:
            return await handle(read)
        finally:
            read.release()


class DirectRoute(BodyRoute):
    """A route whose function is awaited at once, and gives the response.

    It is handed the request, the context, the machine of its path, the body, where it has one, and
    the headers that it names, as text.

    The framework is not between: its dependencies, fields and models of the answer take longer
    than a live table. Nothing else differs: the body is read and checked as that of any other
    route, and what is wrong with it is said in the same words.
    """

    def __init__(self, *args: Any, **named: Any) -> None:
        super().__init__(*args, **named)
        self._headers = self.dependant.header_params
        handle = self.get_route_handler()

        async def answer(scope: Scope, receive: Receive, send: Send) -> None:
            response = await handle(Request(scope, receive))
            await response(scope, receive, send)

        self.app = answer

    async def answer(
        self, request: Request, body: bytes, content: Any, handle: Handler
    ) -> Response:
        """Answer it by calling the function."""
        if request.scope["query_string"]:
            await refuse_unknown_query(request)
        named = {h.name: request.headers.get(h.alias, h.default) for h in self._headers}
        if self.body_field is not None:
            if not body:
                raise RequestValidationError([{"type": "missing", "loc": ("body",), "input": None}])
            named["body"] = content
        scope = request.scope
        context, machine = scope["app"].state.context, scope["path_params"]["machine"]
        answer: Response = await self.endpoint(
            request=request, context=context, machine=machine, **named
        )
        return answer


class Written(Response):
    """An answer that is written: its bytes and what they are, and no more than that to be done."""

    def __init__(self, content: bytes, media_type: str = JSON, status: int = 200) -> None:
        self.status_code = status
        self.body = content
        self.background = None
        self.raw_headers = [
            (b"content-type", media_type.encode()),
            (b"content-length", b"%d" % len(content)),
        ]


class FileRoute(APIRoute):
    """A route whose body is a file; its limit and kinds are those that are documented of it."""

    def get_route_handler(self) -> Handler:
        """Wrap the framework's handler, which is given a request whose file has come."""
        handle = super().get_route_handler()
        extra = self.openapi_extra or {}
        limit, kinds = int(extra[LIMIT_NAME]), tuple(extra["requestBody"]["content"])

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


def stated_of_body(scope: Scope) -> tuple[bytes, bytes]:
    """Read from a request's head its body's length and kind, empty where they are not stated."""
    length = kind = b""
    for name, value in scope["headers"]:
        if name == b"content-length":
            length = value
        elif name == b"content-type":
            kind = value
    return length, kind


async def received(request: Request, most: int) -> bytes:
    """Receive a body of at most so many bytes, or refuse it as soon as it is longer.

    Raises
    ------
    AccessRefused
        If the key of the request was revoked while it came.
    """
    # A header of many digits must not cost time: twenty are more than any limit. What it states
    # may also be untrue, so that what comes is counted all the same.
    length, _ = stated_of_body(request.scope)
    if length.isdigit() and int(length[:20]) > most:
        raise _too_large(most)
    parts: list[bytes] = []
    size = 0
    more = True
    while more:
        message: Message = await request.receive()
        if message["type"] != "http.request":
            raise HTTPException(408, "expected the rest of the body, but the connection ended")
        parts.append(message.get("body", b""))
        size += len(parts[-1])
        if size > most:
            raise _too_large(most)
        more = message.get("more_body", False)
    access: AccessControl = request.app.state.access
    access.confirm_request(request.scope)  # the body may have been long on its way
    return parts[0] if len(parts) == 1 else b"".join(parts)


def _too_large(most: int) -> HTTPException:
    return HTTPException(413, f"expected a body of at most {most} bytes; send it in parts")


def _refuse_other_kinds(request: Request, kinds: Sequence[str]) -> None:
    """Refuse what is of none of these kinds; a browser sends them for no other site's page."""
    got = stated_of_body(request.scope)[1].decode("latin-1")
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
            error.name or "body", f"expected each name once in an object, got {error.name!r} twice"
        ) from None
    try:
        return adapter.validate_python(content)
    except ValidationError as error:
        wrong = shown_errors(error)
        if any(e["type"] in UNKNOWN for e in wrong):
            wrong = with_known_fields(wrong, _schema_of(adapter))
        errors = [{**e, "loc": ("body", *e["loc"])} for e in wrong]
        raise RequestValidationError(errors) from None
