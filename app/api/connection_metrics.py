"""How connections fare, for Prometheus; from all workers and services alike."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from typing import Final

from prometheus_client import CollectorRegistry, Gauge, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from app.connections.connection import Connection
from app.connections.running import ConnectionsNow
from app.errors import StorageUnavailable
from app.services.tell_receivers import Receivers

MOST_CONNECTIONS: Final = 1000
"""Connections whose values are given, the first by name: each is some eight time series."""

LABELS: Final = ("connection", "kind")


def receiver_metrics(ask: Callable[[], Receivers]) -> bytes:
    """Write in Prometheus' text format who cannot be told of alarms; nothing where nobody says."""
    try:
        receivers = ask().receivers
    except StorageUnavailable:
        return b""
    registry = CollectorRegistry()
    trouble = Gauge(
        "thermap_receiver_trouble",
        "1 where a receiver of alarms cannot be told what it should be told",
        ("receiver",),
        registry=registry,
    )
    for receiver in receivers:
        trouble.labels(receiver.name).set(float(bool(receiver.trouble)))
    return generate_latest(registry) if receivers else b""


def connection_metrics(ask: Callable[[], ConnectionsNow], now: datetime) -> bytes:
    """Write in Prometheus' text format how connections fare; nothing where nobody says."""
    try:
        connections = ask()
    except StorageUnavailable:
        return b""
    registry = CollectorRegistry()
    registry.register(_Values(connections, now))
    return generate_latest(registry)


class _Values(Collector):
    """The values of one moment."""

    def __init__(self, connections: ConnectionsNow, now: datetime) -> None:
        self._found = connections
        self._now = now
        self._named: dict[tuple[str, str], list[Connection]] = defaultdict(list)
        # Services that share a broker's topics have a connection of one name each.
        for connection in sorted(connections.connections, key=lambda item: (item.name, item.kind)):
            self._named[connection.name, connection.kind].append(connection)

    def collect(self) -> Iterator[Metric]:
        """Hand them out."""
        yield self._gauge(
            "thermap_connection_up",
            "1 while a connection has contact, 0 where it, or one of several of its name, has none",
            lambda all_: float(all(connection.connected for connection in all_)),
        )
        yield self._gauge(
            "thermap_connection_last_value_age_seconds",
            "Age of the last value of a connection, of several of its name the newest [s]",
            self._age_s,
        )
        yield self._gauge(
            "thermap_connection_known_values",
            "Sensors and states of a connection that have a value now",
            lambda all_: float(sum(connection.known for connection in all_)),
        )
        yield self._gauge(
            "thermap_connection_trouble",
            "1 where something is the matter with a connection, as the list of connections says",
            lambda all_: float(any(connection.trouble for connection in all_)),
        )
        for name, description, count in (
            ("taken", "Messages whose values were stored", lambda connection: connection.taken),
            (
                "dropped",
                "Messages that were dropped, as too many waited",
                lambda connection: connection.dropped,
            ),
            (
                "refused",
                "Messages or values that were refused",
                lambda connection: connection.refused,
            ),
            (
                "lost",
                "Observations that were gone before they could be read",
                lambda connection: connection.lost,
            ),
        ):
            yield self._counter(f"thermap_connection_{name}", description, count)
        yield GaugeMetricFamily(
            "thermap_machines_with_wrong_clocks",
            "Machines of whose senders one stated a time that was more than 5 s off, within the "
            "last minute",
            value=len(self._found.machines_with_wrong_clocks),
        )

    def _age_s(self, all_: Sequence[Connection]) -> float | None:
        times = [
            connection.last_value_at for connection in all_ if connection.last_value_at is not None
        ]
        return (self._now - max(times)).total_seconds() if times else None

    def _gauge(
        self, name: str, description: str, read: Callable[[Sequence[Connection]], float | None]
    ) -> Metric:
        family = GaugeMetricFamily(name, description, labels=LABELS)
        for which, all_ in self._told():
            value = read(all_)
            if value is not None:
                family.add_metric(which, value)
        return family

    def _counter(self, name: str, description: str, read: Callable[[Connection], int]) -> Metric:
        family = CounterMetricFamily(name, description, labels=LABELS)
        for which, all_ in self._told():
            family.add_metric(which, sum(map(read, all_)))
        return family

    def _told(self) -> list[tuple[tuple[str, str], list[Connection]]]:
        return list(self._named.items())[:MOST_CONNECTIONS]
