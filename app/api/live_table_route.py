"""A route without FastAPI's machinery, for the one answer that controllers wait for.

The route is documented like any other by its function's signature, but its
function is given the bare request and returns the bytes itself: no dependency
solving, no model made of the answer. Errors are answered as everywhere.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from fastapi.routing import APIRoute
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

LiveHandler = Callable[[Request], Awaitable[Response]]


class LiveTableRoute(APIRoute):
    """An APIRoute whose requests go straight to `handler`."""

    def __init__(self, path: str, endpoint: Callable[..., Any], **options: Any) -> None:
        super().__init__(path, endpoint, **options)
        self.handler: LiveHandler = endpoint.handler  # type: ignore[attr-defined]

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, unless the method is another: then as any route does."""
        if scope["method"] not in (self.methods or ()):
            await super().handle(scope, receive, send)
            return
        response = await self.handler(Request(scope, receive, send))
        await response(scope, receive, send)


def documented_by(document: Callable[..., Any]) -> Callable[[LiveHandler], Callable[..., Any]]:
    """Tie a handler to the function whose signature documents it."""

    def tie(handler: LiveHandler) -> Callable[..., Any]:
        document.handler = handler  # type: ignore[attr-defined]
        return document

    return tie
