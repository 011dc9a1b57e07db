"""Refusing bodies that are too large, before they fill the memory."""

from __future__ import annotations

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.api.error_responses import problem


class BodyLimitMiddleware:
    """Refuses a body by its stated length, and one in pieces when they become too many.

    The framework's own limit answers in plain text; this one answers with a problem.
    """

    def __init__(self, app: ASGIApp, max_body_bytes: int) -> None:
        self.app = app
        self.max_body_bytes = max_body_bytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, unless it is known to be too large."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
        elif _stated_bytes(scope) > self.max_body_bytes:
            await problem(413, "Too large", self._expected)(scope, receive, send)
        else:
            await self.app(scope, self._counting(receive), send)

    def _counting(self, receive: Receive) -> Receive:
        came = 0

        async def receive_counted() -> Message:
            nonlocal came
            message = await receive()
            came += len(message.get("body", b""))
            if came > self.max_body_bytes:
                raise HTTPException(413, self._expected)
            return message

        return receive_counted

    @property
    def _expected(self) -> str:
        return f"expected a body of at most {self.max_body_bytes} bytes; send it in parts"


def _stated_bytes(scope: Scope) -> int:
    stated = Headers(scope=scope).get("content-length", "")
    return int(stated[:20]) if stated.isascii() and stated.isdecimal() else 0
