"""`[[mqtt.sparkplug]]`: metrics of edge nodes and devices, as readings of machines."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from time import monotonic
from typing import Final

from app.connections.intake import Fate, TakesValues
from app.connections.known_values import KnownValues
from app.connections.mqtt_tables import SparkplugTable
from app.connections.sparkplug_nodes import NAMESPACE, Heard, Nodes, Place
from app.connections.sparkplug_payload import Metric

REBIRTH_EVERY_S: Final = 10.0
"""A node is asked for a birth once in so long [s]."""


class SparkplugFollower:
    """The nodes of one broker, as far as the file names them."""

    def __init__(self, tables: Sequence[SparkplugTable], intake: TakesValues) -> None:
        self._intake = intake
        self._nodes = Nodes({Place(table.group, table.node, table.device) for table in tables})
        self.absent: set[tuple[str, str]] = set()
        """Machines and sensors of which a node says that they have no value."""
        self._asked_s: dict[tuple[str, str], float] = {}
        self._followed = [
            (table, KnownValues(intake, table.machine, table.sensors, table.state), _names(table))
            for table in tables
        ]

    def __len__(self) -> int:
        return sum(len(known_values) for _, known_values, _ in self._followed)

    @property
    def filters(self) -> list[str]:
        """What the broker is asked for: all of a node, whose messages are numbered together."""
        nodes = {(table.group, table.node) for table, _, _ in self._followed}
        return [f"{NAMESPACE}/{group}/+/{node}/#" for group, node in sorted(nodes)]

    @property
    def lost(self) -> int:
        """Messages that are missing."""
        return self._nodes.lost

    def forget(self) -> None:
        """Know nothing any more: contact was lost."""
        self.absent.clear()
        self._nodes.forget()
        for _, known_values, _ in self._followed:
            known_values.forget()

    def repeat(self) -> None:
        """Tell again what holds: nodes tell changes only."""
        for _, known_values, _ in self._followed:
            known_values.repeat()

    def take(self, topic: str, payload: bytes) -> list[asyncio.Future[Fate]]:
        """Take a message; Unusable as `Nodes.hear`."""
        futures = []
        for heard in self._nodes.hear(topic, payload):
            for table, known_values, names in self._followed:
                futures += self._apply(heard, table, known_values, names)
        return futures

    def _note_absent(self, table: SparkplugTable, name: str, value: float | None) -> None:
        if value is None and name in table.sensors:
            self.absent.add((table.machine, name))
        else:
            self.absent.discard((table.machine, name))

    def unsure(self) -> list[str]:
        """Name the nodes of which a birth is missing."""
        return [f"{group}/{node}" for group, node in sorted(self._nodes.unsure)]

    def rebirths_due(self) -> list[str]:
        """Give the topics of commands that are to be sent now: births are missing, and wanted."""
        now_s = monotonic()
        wanted = {(table.group, table.node) for table, _, _ in self._followed if table.rebirth}
        due = [
            node
            for node in sorted(wanted - self._nodes.born)
            if now_s - self._asked_s.get(node, -REBIRTH_EVERY_S) >= REBIRTH_EVERY_S
        ]
        self._asked_s.update(dict.fromkeys(due, now_s))
        return [f"{NAMESPACE}/{group}/NCMD/{node}" for group, node in due]

    def _apply(
        self,
        heard: Heard,
        table: SparkplugTable,
        known_values: KnownValues,
        names: Mapping[str, Sequence[str]],
    ) -> list[asyncio.Future[Fate]]:
        """Hand over what is the table's; without a birth its values are gone."""
        place = heard.place
        if (place.group, place.node) != (table.group, table.node):
            return []
        if heard.is_gone and place.device in (None, table.device):
            known_values.forget()
        if place.device != table.device:
            return []
        now: dict[str, float | None] = {}
        futures = []
        for metric in heard.metrics:
            for name in names.get(metric.name, ()):
                value = _value(table, name, metric)
                if not metric.is_historical:
                    now[name] = value
                    self._note_absent(table, name, value)
                elif value is not None and name in table.sensors and metric.time is not None:
                    futures.append(self._intake.offer(table.machine, {name: value}, metric.time))
        future = known_values.take(now)
        return [*futures, future] if future is not None else futures


def _names(table: SparkplugTable) -> Mapping[str, Sequence[str]]:
    """List by metrics what is read from each."""
    names: dict[str, list[str]] = {}
    for name, sensor in table.sensors.items():
        names.setdefault(sensor.metric, []).append(name)
    for name, metric in table.state.items():
        names.setdefault(metric, []).append(name)
    return names


def _value(table: SparkplugTable, name: str, metric: Metric) -> float | None:
    if metric.value is None or name not in table.sensors:
        return metric.value
    return table.sensors[name].to_c(metric.value)
