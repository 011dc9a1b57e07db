"""Follow an MTConnect agent for as long as it is told to, through restarts, gaps and nonsense."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import aclosing
from dataclasses import dataclass, field
from typing import Final

import httpx

from app.connections.connection import PLAIN, TemperatureTable
from app.connections.mtconnect_agent import Agent
from app.connections.mtconnect_documents import (
    AgentRefused,
    DataItem,
    NotMtconnect,
    Observation,
    Streams,
)
from app.connections.mtconnect_sequence import Place
from app.connections.sparing_log import SparingLog
from app.errors import counted
from app.units import TemperatureUnit

log = logging.getLogger("thermap")


SHOWN: Final = 5
"""Sensors whose trouble is put in words; of the others only how many they are."""


@dataclass(frozen=True, slots=True)
class Followed:
    """A data item that a sensor or a state is read from.

    Parameters
    ----------
    item
        Its id, or its name where only one item has it.
    temperature
        How a temperature is written; None: a state, which is taken as it is.
    """

    item: str
    temperature: TemperatureTable | None = PLAIN


@dataclass(frozen=True, slots=True)
class Found:
    """What an agent observed of one that is followed: [°C] or the state's unit, None if missing."""

    name: str
    value: float | None
    observation: Observation


@dataclass(slots=True)
class AgentFollower:
    """Reads the data items that are followed, and hands on what it finds.

    Parameters
    ----------
    followed
        Name of the sensor or state to its data item.
    take
        Takes what was found, in the order of the agent's sequence; nothing is handed on twice.
        An empty list says that contact was lost: what was known is not known any more.
    is_streamed
        Let the agent send, instead of asking every `every_s` seconds.
    """

    agent: Agent
    followed: Mapping[str, Followed]
    take: Callable[[Sequence[Found]], None]
    every_s: float = 1.0
    is_streamed: bool = False
    unreadable: int = 0
    is_connected: bool = False
    place: Place = field(init=False)
    _trouble: str = ""
    _matters: dict[str, str] = field(default_factory=dict)
    _units: dict[str, TemperatureUnit] = field(default_factory=dict)
    _items: dict[str, str] = field(default_factory=dict)
    _log: SparingLog = field(default_factory=SparingLog)

    def __post_init__(self) -> None:
        self.place = Place(say=lambda words: log.warning("MTConnect: %s", words))

    @property
    def trouble(self) -> str:
        """What is the matter: with the agent, then with what is followed; empty where nothing."""
        matters = [f"{name}: {words}" if name else words for name, words in self._matters.items()]
        shown = matters[:SHOWN]
        if len(matters) > SHOWN:
            shown.append(f"and {counted(len(matters) - SHOWN, 'other')}")
        return "; ".join([*([self._trouble] if self._trouble else []), *shown])

    @property
    def readable(self) -> set[str]:
        """Sensors and states whose data items the agent has: after a restart others, perhaps."""
        return set(self._items)

    async def run(self) -> None:
        """Follow until contact is lost."""
        try:
            await self._begin()
            self.is_connected = True
            await self._go_on()
        except httpx.HTTPError as why:
            raise NotMtconnect(str(why) or type(why).__name__) from None
        finally:
            if self.is_connected:
                self.is_connected = False
                self.take([])

    def lost(self, words: str) -> None:
        """Take note of why there is no contact."""
        self._say(words)

    async def _begin(self) -> None:
        """Find the data items and what holds now."""
        self._find(await self.agent.probe())
        self._begin_at(await self.agent.current())

    def _begin_at(self, streams: Streams) -> None:
        self._take(streams, self.place.take_current(streams))

    async def _go_on(self) -> None:
        """Follow the sequence; after a restart of the agent its items are found anew."""
        while True:
            since = self.place.next_sequence
            if since is None:
                await self._begin()
            else:
                await self._go_on_from(since)

    async def _go_on_from(self, since: int) -> None:
        try:
            await (self._stream(since) if self.is_streamed else self._poll(since))
        except AgentRefused as why:
            if not why.is_out_of_range:
                raise
            self.place.leave()
            self._begin_at(await self.agent.current())
            await asyncio.sleep(self.every_s)

    async def _poll(self, since: int) -> None:
        streams = await self.agent.sample(since)
        self._take(streams, self.place.take_sample(streams))
        if len(streams.observations) < self.agent.most_at_once or self.place.next_sequence is None:
            await asyncio.sleep(self.every_s)

    async def _stream(self, since: int) -> None:
        async with aclosing(self.agent.stream(since, self.every_s)) as documents:
            async for streams in documents:
                self._take(streams, self.place.take_sample(streams))
                if self.place.next_sequence is None:
                    return
        # The agent ended it, or does not stream: this is then polling.
        await asyncio.sleep(self.every_s)

    def _find(self, items: Sequence[DataItem]) -> None:
        """Find by id or by name what is followed; say what there is not."""
        self._items, self._units, matters = {}, {}, []
        by_id: dict[str, list[DataItem]] = {}
        by_name: dict[str, list[DataItem]] = {}
        for one in items:
            by_id.setdefault(one.item, []).append(one)
            by_name.setdefault(one.name, []).append(one)
        for name, wanted in self.followed.items():
            found = by_id.get(wanted.item) or by_name.get(wanted.item, [])
            if len(found) != 1:
                why = "no data item has that" if not found else f"{len(found)} data items have it"
                matters.append(
                    f"{name}: expected the id or name of one, got {wanted.item!r}: {why}"
                )
                continue
            if wanted.temperature is not None:
                stated, unit = found[0].units or TemperatureUnit.CELSIUS, wanted.temperature.unit
                if (unit or stated) not in list(TemperatureUnit):
                    matters.append(f"{name}: expected a unit of temperature, got {stated!r}")
                    continue
                if unit and found[0].units not in ("", unit):
                    matters.append(
                        f"{name}: expected {unit} as configured, got {stated} from the agent; "
                        "taken as configured"
                    )
                self._units[name] = unit or TemperatureUnit(stated)
            self._items[name] = found[0].item
        self._matters = {}
        self._say("; ".join(matters))

    def _take(self, streams: Streams, observations: Sequence[Observation]) -> None:
        """Hand on what is followed; what cannot be read is missing, and counted."""
        if streams.unnumbered:
            self._matters[""] = (
                f"{counted(streams.unnumbered, 'observation')} of the agent had no sequence "
                "number, without which new ones cannot be told from old ones: not read"
            )
        elif observations:
            self._matters.pop("", None)
        names: dict[str, list[str]] = {}
        for name, item in self._items.items():
            names.setdefault(item, []).append(name)
        found = [
            Found(name, self._value_of(name, observation), observation)
            for observation in observations
            for name in names.get(observation.item, ())
        ]
        if found:
            self.take(found)

    def _value_of(self, name: str, observation: Observation) -> float | None:
        temperature, value = self.followed[name].temperature, observation.value
        if value is None:
            self.unreadable += not observation.is_unavailable
            self._matters[name] = words = observation.words
            self._log.warn(name, f"MTConnect: {name}: {words}")
            return None
        self._matters.pop(name, None)
        return value if temperature is None else temperature.to_c(value, self._units[name])

    def _say(self, words: str) -> None:
        if words and words != self._trouble:
            log.warning("MTConnect: %s", words)
        self._trouble = words
