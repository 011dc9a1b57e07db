"""The short way to the live table: a request that is plain goes past the framework.

Routing, dependencies, middlewares and models cost several times what the table
itself costs. A short `POST …/compensation` for a machine in memory, with content
in order, is answered here. Everything else, and everything that is wrong in any
way, goes the ordinary way with what has been read of it, so that there is one
place for refusals and their words.

Sensors resolve a tenth or a hundredth of a degree, so the same request comes
again and again: but for its time, its answer is remembered. With adopted effects, which may
depend on the time, it is computed each time.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from datetime import UTC, datetime
from threading import Lock
from time import perf_counter
from weakref import ref

import orjson
from fastapi import FastAPI
from pydantic import TypeAdapter
from starlette.types import Message, Receive, Scope, Send

from app.api.access import AccessControl, name_who_asks
from app.api.gate import Gate
from app.api.metrics import UNKNOWN, Metrics
from app.api.request_log import RequestLog
from app.api.schemas.compensation import CompensationRequest
from app.api.table_json import OPTIONS, table_json
from app.live.registry import LiveModel
from app.services.context import Context
from app.services.live_table import table_at

BEFORE = "/v1/machines/"
AFTER = "/compensation"
ROUTE = f"{BEFORE}{{machine}}{AFTER}"
JSON_HEADER = (b"content-type", b"application/json")

LARGEST_PLAIN_BODY = 4096
"""Longer bodies go the ordinary way [bytes]; some hundred sensors fit."""

LARGEST_PLAIN_TABLE = 4000
"""Larger tables go the ordinary way [numbers]: remembered answers would fill the memory."""

ANSWERS_BYTES = 32 * 2**20
"""Room for remembered answers, over all machines: some 2,000 of 12 × 21 numbers."""

_ANSWER_BYTES = 500
"""What an answer takes besides its text and that of its question: places in tables, headers."""

WITHOUT_BODY = "thermap.without_body"
"""Marks a request of which only the head is answered: a stream would never end."""

_SOME_TIME = datetime(1970, 1, 1, tzinfo=UTC)
_SOME_TIME_TEXT = orjson.dumps(_SOME_TIME, option=OPTIONS)

_REQUEST = TypeAdapter(CompensationRequest).validator


class ThermapService(FastAPI):
    """The application; `state.context`, `metrics`, `gate` and `access` are set by `create_app`."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, and write a line about it."""
        if scope["type"] != "http":
            await super().__call__(scope, receive, send)
            return
        request = RequestLog(scope, send)
        try:
            await self._answer(scope, receive, request.send)
        finally:
            request.end()

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a plain request for a table at once, any other the ordinary way."""
        started = perf_counter()
        gate: Gate = self.state.gate
        metrics: Metrics = self.state.metrics
        refused = gate.refusal(scope)
        access: AccessControl = self.state.access
        if refused is None and access.is_on:
            refused = await access.refusal(scope)
        if refused is not None:
            await refused(scope, receive, send)
            metrics.count(UNKNOWN, UNKNOWN, refused.status_code, perf_counter() - started)
            return
        if scope["method"] == "HEAD":
            as_get = {**scope, "method": "GET", WITHOUT_BODY: True}
            await super().__call__(as_get, receive, _without_body(send))
            return
        if not _may_be_plain(scope):
            if scope["method"] != "GET":
                name_who_asks(scope)  # what is plain changes nothing, and is told nowhere
            await super().__call__(scope, receive, send)
            return
        messages, body = await _read(receive)
        machine_id = scope["path"][len(BEFORE) : -len(AFTER)]
        content = None if body is None else plain_answer(self.state.context, machine_id, body)
        if content is None:
            await super().__call__(scope, _again(messages, receive), send)
            return
        headers = [JSON_HEADER, (b"content-length", b"%d" % len(content))]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        await send({"type": "http.response.body", "body": content})
        metrics.count(ROUTE, "POST", 200, perf_counter() - started)


def plain_answer(context: Context, machine_id: str, body: bytes) -> bytes | None:
    """Write the table if the request is in order in every way, else None."""
    live = context.live.get(machine_id)
    if live is None or context.live.database.trouble is not None:
        return None
    try:
        if live.current.effects:
            return _answer(live.current, body, context.now())
        before, after = ANSWERS.around_time(live.current, body)
    except Exception:
        return None  # whatever it is, the ordinary way meets it too, and has the words for it
    return b"".join((before, orjson.dumps(context.now(), option=OPTIONS), after))


class Answers:
    """Answers that were written, in so much memory at most: those asked for longest ago go first.

    A model is not held by its answers: with each version of each machine there is another one.
    """

    def __init__(self, most_bytes: int) -> None:
        self._most_bytes = most_bytes
        self._kept: OrderedDict[tuple[ref[LiveModel], bytes], tuple[bytes, bytes]] = OrderedDict()
        self._lock = Lock()
        self.bytes = 0

    def around_time(self, current: LiveModel, body: bytes) -> tuple[bytes, bytes]:
        """Find the answer to a body, or write it: what comes before and after the time."""
        key = (ref(current), body)
        with self._lock:
            found = self._kept.get(key)
            if found is not None:
                self._kept.move_to_end(key)
                return found
        found = _around_time(current, body)
        with self._lock:
            if key not in self._kept:
                self._kept[key] = found
                self.bytes += _size(body, found)
            while self.bytes > self._most_bytes:
                (_, oldest), answer = self._kept.popitem(last=False)
                self.bytes -= _size(oldest, answer)
        return found


def _size(body: bytes, answer: tuple[bytes, bytes]) -> int:
    """Bytes that an answer and its question take."""
    return len(body) + len(answer[0]) + len(answer[1]) + _ANSWER_BYTES


ANSWERS = Answers(ANSWERS_BYTES)


def _around_time(current: LiveModel, body: bytes) -> tuple[bytes, bytes]:
    """Write the answer to a body: what comes before and after the time of computing."""
    if current.model.numbers > LARGEST_PLAIN_TABLE:
        raise ValueError("too large to be remembered")
    # No real table is of 1970: its time marks the place where the present one goes.
    before, _, after = _answer(current, body, _SOME_TIME).partition(_SOME_TIME_TEXT)
    return before, after


def _answer(current: LiveModel, body: bytes, now: datetime) -> bytes:
    stated = _REQUEST.validate_json(body)
    names = len(stated.model_fields_set) + len(stated.temperatures_c) + len(stated.state)
    # JSON's parser keeps the last of two equal names; the ordinary way refuses them. Each name has
    # one colon, so that more of them are a repeated name, or a colon in a text: both go that way.
    if body.count(b":") != names:
        raise ValueError("a name may stand there twice")
    return table_json(table_at(current, stated.temperatures_c, now, state=stated.state))


def _may_be_plain(scope: Scope) -> bool:
    return (
        scope["method"] == "POST"
        and not scope["query_string"]
        and scope["path"].endswith(AFTER)
        and scope["path"].startswith(BEFORE)
        and not scope.get("root_path")
        and [v for k, v in scope["headers"] if k == b"content-type"] == [JSON_HEADER[1]]
        # What a page of another site may read is said in headers that the ordinary way writes.
        and not any(k == b"origin" for k, _ in scope["headers"])
    )


def _without_body(send: Send) -> Send:
    """Send what GET answers, but for its body (RFC 9110, 9.3.2)."""

    async def send_head(message: Message) -> None:
        if message["type"] == "http.response.body":
            message = {**message, "body": b""}
        await send(message)

    return send_head


async def _read(receive: Receive) -> tuple[list[Message], bytes | None]:
    """Read a short body whole, or as much of a long one as shows that it is long (None)."""
    messages = []
    body = b""
    while True:
        message = await receive()
        messages.append(message)
        body += message.get("body", b"")
        # A sender who went away is the ordinary way's as well: it has been told, and ends.
        if len(body) > LARGEST_PLAIN_BODY or message["type"] != "http.request":
            return messages, None
        if not message.get("more_body", False):
            return messages, body


def _again(read: list[Message], receive: Receive) -> Receive:
    """Hand out once more what has been read, then whatever follows."""
    waiting = deque(read)

    async def receive_again() -> Message:
        return waiting.popleft() if waiting else await receive()

    return receive_again
