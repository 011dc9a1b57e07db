"""Counting requests, for Prometheus."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from itertools import accumulate
from typing import Final

from prometheus_client import CollectorRegistry, Gauge
from prometheus_client.core import CounterMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.registry import Collector

from app.live.registry import LiveRegistry

METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})
"""Others are counted together: a client may invent as many as it likes."""

UNKNOWN = "unknown"
"""Route and method of requests that reached no route."""

BUCKETS_S: Final = (0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0)


class Metrics:
    """The service's own figures, in a registry of their own.

    Parameters
    ----------
    worker
        Number of this process among several that are asked under one address: every figure then
        says so in a label, for the next one may be another's. 0 for one alone.
    """

    def __init__(self, live: LiveRegistry, worker: int = 0) -> None:
        self.registry = CollectorRegistry()
        labels = {"worker": str(worker)} if worker else {}
        self._requests = _Requests(labels)
        self.registry.register(self._requests)
        self.count = self._requests.count
        machines = Gauge(
            "thermap_machines_in_memory",
            "Machines whose model is in memory",
            list(labels),
            registry=self.registry,
        )
        _of(machines, labels).set_function(lambda: len(live))
        away = Gauge(
            "thermap_database_away",
            "1 while the database is away, does not answer or is locked",
            list(labels),
            registry=self.registry,
        )
        _of(away, labels).set_function(lambda: live.database.trouble is not None)


def _of(gauge: Gauge, labels: Mapping[str, str]) -> Gauge:
    """Give the one series of a gauge."""
    return gauge.labels(**labels) if labels else gauge


class _Times:
    """How many requests took how long: one count for each bucket, and one for what took longer."""

    __slots__ = ("counts", "sum_s")

    def __init__(self) -> None:
        self.counts = [0] * (len(BUCKETS_S) + 1)
        self.sum_s = 0.0


class _Requests(Collector):
    """Requests by route, handed to the library when somebody asks.

    All are counted on the event loop, so without the library's locks: with them counting takes
    longer than reading a request for a table.
    """

    def __init__(self, labels: Mapping[str, str]) -> None:
        self._own = labels
        self._answered: Counter[tuple[str, str, int]] = Counter()
        self._times: defaultdict[tuple[str, str], _Times] = defaultdict(_Times)

    def count(self, route: str, method: str, status: int, seconds: float) -> None:
        """Count one answered request."""
        self._answered[route, method, status] += 1
        times = self._times[route, method]
        times.sum_s += seconds
        times.counts[bisect_left(BUCKETS_S, seconds)] += 1

    def collect(self) -> Iterator[Metric]:
        """Hand out what has been counted."""
        requests = CounterMetricFamily(
            "thermap_requests",
            "Requests by route, method and status",
            labels=["route", "method", "status", *self._own],
        )
        for (route, method, status), n in list(self._answered.items()):
            requests.add_metric([route, method, str(status), *self._own.values()], n)
        yield requests
        seconds = HistogramMetricFamily(
            "thermap_request_seconds",
            "Time to the whole answer",
            labels=["route", "method", *self._own],
        )
        limits = [*map(str, BUCKETS_S), "+Inf"]
        for (route, method), times in list(self._times.items()):
            buckets = list(zip(limits, accumulate(times.counts), strict=True))
            seconds.add_metric([route, method, *self._own.values()], buckets, times.sum_s)
        yield seconds
