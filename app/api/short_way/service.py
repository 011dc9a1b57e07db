"""The application: what is plain goes the short way, all else the framework's."""

from __future__ import annotations

from collections.abc import Mapping
from time import perf_counter
from typing import Final

from fastapi import FastAPI
from starlette.types import Message, Receive, Scope, Send

from app.access.authorization import as_service
from app.api.access import AccessControl, name_who_asks
from app.api.error_responses import problem_of
from app.api.gate import Gate
from app.api.media_types import JSON
from app.api.metrics import UNKNOWN, Metrics
from app.api.request_log import RequestLog
from app.api.short_way.plain import (
    Answer,
    ShortWay,
    again,
    machine_and_room,
    may_be_short,
    read_short,
)
from app.api.short_way.readings import READINGS
from app.api.short_way.tables import TABLES
from app.errors import AccessRefused, StorageUnavailable

JSON_HEADER: Final = (b"content-type", JSON.encode())

SHORT_WAYS: Final[Mapping[str, ShortWay]] = {"compensation": TABLES, "readings": READINGS}
"""By what comes after the machine in a path."""

WITHOUT_BODY: Final = "thermap.without_body"
"""Marks a request of which only the head is answered: a stream would never end."""


class ThermapService(FastAPI):
    """The application; `state.context`, `metrics`, `gate` and `access` are set by `create_app`."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, and write a line about it."""
        if scope["type"] != "http":
            await super().__call__(scope, receive, send)
            return
        request = RequestLog(scope, send)
        try:
            with as_service():  # by what a request is let in is forgotten at its end
                await self._answer(scope, receive, request.send)
        finally:
            request.end()

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a plain request at once, any other the ordinary way."""
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
        machine_id, room = machine_and_room(scope) or ("", "")
        short_way = SHORT_WAYS.get(room)
        most = 0 if short_way is None else min(short_way.longest, self.state.max_body_bytes)
        if short_way is not None and may_be_short(scope, most):
            messages, body = await read_short(receive, most)
            if body is not None:
                status = await self._go(short_way, machine_id, body, scope, receive, send)
                if status is not None:
                    metrics.count(short_way.route, "POST", status, perf_counter() - started)
                    return
            receive = again(messages, receive)
        if scope["method"] != "GET":
            name_who_asks(scope)  # what goes the short way is told in no log
        await super().__call__(scope, receive, send)

    async def _go(
        self,
        short_way: ShortWay,
        machine_id: str,
        body: bytes,
        scope: Scope,
        receive: Receive,
        send: Send,
    ) -> int | None:
        """Answer by a short way; say with which status, None where the ordinary one must."""
        access: AccessControl = self.state.access
        try:
            access.confirm_request(scope)
            answer = await short_way.answer(self.state.context, machine_id, body)
        except (AccessRefused, StorageUnavailable) as error:
            refused = problem_of(scope, error)
            await refused(scope, receive, send)
            return refused.status_code
        if answer is None:
            return None
        await _send_answer(answer, send)
        return answer.status


async def _send_answer(answer: Answer, send: Send) -> None:
    status, content = answer
    headers = [JSON_HEADER, (b"content-length", b"%d" % len(content))]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": content})


def _without_body(send: Send) -> Send:
    """Send what GET answers, but for its body (RFC 9110, 9.3.2)."""

    async def send_head(message: Message) -> None:
        if message["type"] == "http.response.body":
            message = {**message, "body": b""}
        await send(message)

    return send_head
