"""The application: what stands between a connection and a route, for every request alike."""

from __future__ import annotations

from contextlib import AsyncExitStack
from functools import cached_property
from time import perf_counter
from typing import Any, Final

from fastapi import FastAPI, Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Match
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.access.authorization import asking
from app.api.access import AccessControl, Asker
from app.api.bodies import DirectRoute
from app.api.error_responses import error_response, is_expected
from app.api.gate import Gate
from app.api.metrics import METHODS, UNKNOWN, Metrics
from app.api.request_log import RequestLog
from app.events.event import acting

WITHOUT_BODY: Final = "thermap.without_body"
"""Marks a request of which only the head is answered: a stream would never end."""

_LOG: Final = "thermap.request_log"
"""Where a request's line of the log is while it is answered."""


class ThermapService(FastAPI):
    """The application; `state.context`, `metrics`, `gate` and `access` are set by `create_app`.

    The framework's layers for errors, telemetry and long bodies cost each request as much as the
    live table itself. So a request is numbered, let in, counted and, where an error is raised,
    answered by this class alone, whatever its route; and the few routes that are asked all the
    time are looked for before the others.
    """

    def build_middleware_stack(self) -> ASGIApp:
        """Put before the routes what was added by `add_middleware`, and nothing else."""
        stack: ASGIApp = self._route
        for middleware in reversed(self.user_middleware):
            added: Any = middleware.cls
            stack = added(stack, *middleware.args, **middleware.kwargs)
        return stack

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, count it, and write a line about it."""
        if scope["type"] != "http":
            await super().__call__(scope, receive, send)
            return
        #     request ─▶ gate ─▶ route is found ─▶ key ─▶ added layers ─▶ route answers
        #                │ host, page             │ what the route needs     │
        #                ▼                        ▼                          ▼
        #             refused                  refused      an error is answered for it (`_route`)
        #
        # All three are counted, and each has its line in the log.
        log = scope[_LOG] = RequestLog(scope, send)
        started = perf_counter()
        scope["app"] = self
        is_head = scope["method"] == "HEAD"
        answered = {**scope, "method": "GET", WITHOUT_BODY: True} if is_head else scope
        before = asking.set(None)  # by what a request is let in is forgotten at its end
        try:
            refused = await self._refusal(answered)
            if refused is not None:
                await refused(scope, receive, log.send)
                return
            if answered["method"] != "GET":
                acting.set(Asker(answered))
            await self.answer(answered, receive, _without_body(log.send) if is_head else log.send)
        finally:
            asking.reset(before)
            self._count(answered, log.status or 500, perf_counter() - started)
            log.end()

    @cached_property
    def answer(self) -> ASGIApp:
        """What answers who was let in."""
        return self.build_middleware_stack()

    @cached_property
    def direct_routes(self) -> list[DirectRoute]:
        """The routes that are looked for first; the router has them, too, for all else."""
        return [route for route in self.router.routes if isinstance(route, DirectRoute)]

    async def _refusal(self, scope: Scope) -> Response | None:
        """Give the answer to a request that is not let in, which its route says."""
        gate: Gate = self.state.gate
        access: AccessControl = self.state.access
        refused = gate.refusal(scope)
        if refused is None:
            self.find_route(scope)
            if access.is_on:
                refused = await access.refusal(scope)
        return refused

    def find_route(self, scope: Scope) -> None:
        """Put a request's route into its scope, where there is one: what lets it in answers it."""
        for direct in self.direct_routes:
            found = direct.path_regex.match(scope["path"])
            if found and scope["method"] in (direct.methods or ()):
                scope["route"], scope["path_params"] = direct, found.groupdict()
                return
        other: tuple[BaseRoute, Scope] | None = None
        for route in self.router.routes:
            match, more = route.matches(scope)
            if match is Match.FULL:
                other = route, more
                break
            if match is Match.PARTIAL and other is None:
                other = route, more  # at this path, for other methods
        if other is not None:
            scope["route"] = other[0]
            scope.update(other[1])

    def _count(self, scope: Scope, status: int, seconds: float) -> None:
        metrics: Metrics = self.state.metrics
        route = getattr(scope.get("route"), "path", UNKNOWN)
        is_usual = route != UNKNOWN and scope["method"] in METHODS
        metrics.count(route, scope["method"] if is_usual else UNKNOWN, status, seconds)

    async def _route(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let the request's route answer, and answer whatever error it raises."""
        if scope["type"] != "http":
            await self.router(scope, receive, send)
            return
        try:
            route = scope.get("route", self.router)
            if isinstance(route, DirectRoute) and scope["method"] in (route.methods or ()):
                await route.app(scope, receive, send)
                return
            async with AsyncExitStack() as files:
                scope["fastapi_middleware_astack"] = files  # FastAPI's routes close files by it
                await route.handle(scope, receive, send)
        except Exception as error:
            if scope[_LOG].status:
                raise  # too late for another answer: the server ends the connection
            response = error_response(Request(scope), error)
            await response(scope, receive, send)
            if not is_expected(error):
                raise


def _without_body(send: Send) -> Send:
    """Send what GET answers, but for its body (RFC 9110, 9.3.2)."""

    async def send_head(message: Message) -> None:
        if message["type"] == "http.response.body":
            message = {**message, "body": b""}
        await send(message)

    return send_head
