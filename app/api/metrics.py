"""Counting requests, for Prometheus."""

from __future__ import annotations

from time import perf_counter

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app.live.registry import LiveRegistry

METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})
"""Others are counted together: a client may invent as many as it likes."""

UNKNOWN = "unknown"
"""Route and method of requests that reached no route."""

BUCKETS_S = (0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0)


class Metrics:
    """The service's own figures, in a registry of their own."""

    def __init__(self, live: LiveRegistry) -> None:
        self.registry = CollectorRegistry()
        self.requests = Counter(
            "thermap_requests",
            "Requests by route, method and status",
            ["route", "method", "status"],
            registry=self.registry,
        )
        self.seconds = Histogram(
            "thermap_request_seconds",
            "Time to the whole answer",
            ["route", "method"],
            buckets=BUCKETS_S,
            registry=self.registry,
        )
        Gauge(
            "thermap_machines_in_memory",
            "Machines whose model is in memory",
            registry=self.registry,
        ).set_function(lambda: len(live))
        Gauge(
            "thermap_database_away",
            "1 while the database is away, does not answer or is locked",
            registry=self.registry,
        ).set_function(lambda: live.database.trouble is not None)
        self._children: dict[tuple[str, str, int], tuple[Counter, Histogram]] = {}

    def count(self, route: str, method: str, status: int, seconds: float) -> None:
        """Count one answered request."""
        key = (route, method, status)
        child = self._children.get(key)
        if child is None:
            child = (self.requests.labels(*map(str, key)), self.seconds.labels(route, method))
            self._children[key] = child
        child[0].inc()
        child[1].observe(seconds)


class MetricsMiddleware:
    """Counts every request by its route's pattern."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self.app = app
        self.metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on and look at the status that comes back."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        started = perf_counter()
        status = 500

        async def watching(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
            await send(message)

        try:
            await self.app(scope, receive, watching)
        finally:
            route = getattr(scope.get("route"), "path", UNKNOWN)
            known = route != UNKNOWN and scope["method"] in METHODS
            method = scope["method"] if known else UNKNOWN
            self.metrics.count(route, method, status, perf_counter() - started)
