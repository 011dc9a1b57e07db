"""Edge nodes of Sparkplug B as one hears them: births, aliases, gaps, deaths."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

from app.connections.mqtt_payloads import Unusable
from app.connections.sparkplug_payload import SESSION, Metric, Payload, read_payload, signed

NAMESPACE: Final = "spBv1.0"

SEQUENCE: Final = 256
"""A node's messages are numbered below this, round and round."""

COMMANDS: Final = frozenset({"NCMD", "DCMD"})
_OF_NODE: Final = frozenset({"NBIRTH", "NDATA", "NDEATH"})
_OF_DEVICE: Final = frozenset({"DBIRTH", "DDATA", "DDEATH"})


class Place(NamedTuple):
    """A node (without a device), or one of its devices."""

    group: str
    node: str
    device: str | None


class Heard(NamedTuple):
    """What a message says of a node or of a device.

    `is_gone` says that nothing is known any more: of a node this is so of all its devices, too.
    """

    place: Place
    metrics: Sequence[Metric]
    is_gone: bool = False


#               NBIRTH                   the next number (255, then 0)
#    unheard ───────────> born ──────────────────────────────────┐
#     ^                    │ │ ^                                 │
#     │      NDEATH        │ │ └─────────────────────────────────┘
#     ├────────────────────┘ │ another number: messages are missing
#     │                      v
#     └────── NDEATH ────── unsure ──── NBIRTH (`rebirths_due` asks for it) ──> born
#
# A message may have a metric's alias in place of its name and type, which only the birth says, and
# one that is missing may have been a birth: of a node that is unsure metrics with names alone are
# read.
@dataclass(slots=True)
class _Node:
    seq: int | None = None
    session: float | None = None
    born: bool = False
    aliases: dict[tuple[str | None, int], tuple[str, int]] = field(default_factory=dict)
    datatypes: dict[tuple[str | None, str], int] = field(default_factory=dict)

    def forget(self, device: str | None = None) -> None:
        """Forget what births said, of a device or of all."""
        self.aliases = _without(self.aliases, device)
        self.datatypes = _without(self.datatypes, device)


def _without(by_key: dict, device: str | None) -> dict:  # type: ignore[type-arg]
    return {} if device is None else {k: v for k, v in by_key.items() if k[0] != device}


@dataclass(slots=True)
class Nodes:
    """The nodes that were heard.

    Parameters
    ----------
    wanted
        Nodes and devices that are followed: of others no name is remembered.
    lost
        Messages that are missing, by the numbers of those that came.
    unsure
        Nodes of which a birth is needed before aliases can be read.
    """

    wanted: Collection[Place]
    lost: int = 0
    unsure: set[tuple[str, str]] = field(default_factory=set)
    _nodes: dict[tuple[str, str], _Node] = field(default_factory=dict)

    @property
    def born(self) -> set[tuple[str, str]]:
        """The nodes whose births were heard, and every message since."""
        return {place for place, node in self._nodes.items() if node.born}

    def forget(self) -> None:
        """Know nothing any more: contact was lost, and with it any number of messages."""
        self._nodes.clear()
        self.unsure.clear()

    def hear(self, topic: str, content: bytes) -> Iterator[Heard]:
        """Take a message; what it says, in order.

        Raises
        ------
        Unusable
            If it cannot be read, or has aliases that no birth has told of.
        """
        levels = topic.split("/")
        if len(levels) not in (4, 5) or levels[0] != NAMESPACE:
            raise Unusable(f"expected a topic of Sparkplug B, got {topic!r:.120}")
        _, group, kind, name, *rest = levels
        if kind in COMMANDS:
            return
        if kind not in (_OF_DEVICE if rest else _OF_NODE):
            raise Unusable(f"expected a message of Sparkplug B, got {kind!r:.40}")
        place = Place(group, name, rest[0] if rest else None)
        if all(place[:2] != wanted[:2] for wanted in self.wanted):
            return
        payload = read_payload(content)
        node = self._nodes.setdefault((group, name), _Node())
        if kind == "NDEATH":
            yield from self._bury(node, place, payload)
            return
        if kind == "NBIRTH":
            node.forget()
            node.session = _session(payload)
            node.seq, node.born = payload.seq, True
            self.unsure.discard((group, name))
            # Before its metrics: what this birth does not name is not there any more.
            yield Heard(place, (), is_gone=True)
        elif not self._follows(node, payload):
            node.forget()
            # Counted on from here: else each message that follows would count as a gap.
            node.seq, node.born = payload.seq, False
            self.unsure.add((group, name))
            yield Heard(place._replace(device=None), (), is_gone=True)
        if kind == "DDEATH":
            node.forget(place.device)
            yield Heard(place, (), is_gone=True)
            return
        if kind == "DBIRTH":
            node.forget(place.device)
            yield Heard(place, (), is_gone=True)
        if kind in ("NBIRTH", "DBIRTH"):
            self._learn(node, place, payload)
        yield Heard(place, self._named(node, place, payload))

    def _bury(self, node: _Node, place: Place, payload: Payload) -> Iterator[Heard]:
        """Take a node's death, unless it is that of an earlier session."""
        session = _session(payload)
        # The broker publishes a node's death when it misses the node, which may be back by then.
        # The number (bdSeq) says to which birth the death belongs.
        if node.session is not None and session is not None and session != node.session:
            return
        node.forget()
        node.seq, node.born = None, False
        self.unsure.discard((place.group, place.node))
        yield Heard(place, (), is_gone=True)

    def _follows(self, node: _Node, payload: Payload) -> bool:
        """Whether a message is the next one; count those between."""
        if node.seq is None or payload.seq is None:
            return False
        expected = (node.seq + 1) % SEQUENCE
        if payload.seq != expected:
            self.lost += (payload.seq - expected) % SEQUENCE
            return False
        node.seq = expected
        return True

    def _learn(self, node: _Node, place: Place, payload: Payload) -> None:
        if place not in self.wanted:
            return
        for metric in payload.metrics:
            node.datatypes[place.device, metric.name] = metric.datatype
            if metric.alias is not None:
                node.aliases[place.device, metric.alias] = (metric.name, metric.datatype)

    def _named(self, node: _Node, place: Place, payload: Payload) -> list[Metric]:
        named = []
        for metric in payload.metrics:
            name, datatype = metric.name, metric.datatype
            if not name and metric.alias is not None:
                name, datatype_of_alias = node.aliases.get((place.device, metric.alias), ("", 0))
                datatype = datatype or datatype_of_alias
            if not name:
                if not node.born:
                    self.unsure.add((place.group, place.node))
                continue
            datatype = datatype or node.datatypes.get((place.device, name), 0)
            value = None if metric.value is None else signed(metric.value, datatype)
            named.append(replace(metric, name=name, datatype=datatype, value=value))
        return named


def _session(payload: Payload) -> float | None:
    return next((metric.value for metric in payload.metrics if metric.name == SESSION), None)
