"""Follow an MTConnect agent for as long as it is told to, through restarts, gaps and nonsense."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import aclosing

import httpx

from app.connections.follower import Followed, Follower, NewValue
from app.connections.mtconnect_agent import Agent
from app.connections.mtconnect_documents import (
    AgentRefused,
    DataItem,
    NotMtconnect,
    Observation,
    Streams,
)
from app.connections.mtconnect_sequence import Place
from app.errors import counted

log = logging.getLogger("thermap")


class AgentFollower(Follower):
    """Reads an agent's data items; nothing is handed on twice.

    Parameters
    ----------
    is_streamed
        Let the agent send, instead of asking every `every_s` seconds.
    """

    sender = "agent"

    def __init__(
        self,
        agent: Agent,
        followed: Mapping[str, Followed],
        take: Callable[[Sequence[NewValue]], None],
        every_s: float = 1.0,
        is_streamed: bool = False,
    ) -> None:
        super().__init__("MTConnect", followed, take)
        self.agent = agent
        self.unreadable = 0
        self.place = Place(say=lambda words: log.warning("MTConnect: %s", words))
        self._every_s = every_s
        self._is_streamed = is_streamed
        self._items: dict[str, str] = {}

    @property
    def gone(self) -> int:
        """How many observations were overwritten before they were read."""
        return self.place.lost

    @property
    def readable(self) -> set[str]:
        """Sensors and states whose data items the agent has: after a restart others, perhaps."""
        return set(self._items)

    async def _follow(self) -> None:
        try:
            await self._begin()
            self.is_connected = True
            await self._go_on()
        except httpx.HTTPError as why:
            raise NotMtconnect(str(why) or type(why).__name__) from None

    async def _begin(self) -> None:
        """Find the data items and what holds now."""
        self._find(await self.agent.probe())
        self._begin_at(await self.agent.current())

    def _begin_at(self, streams: Streams) -> None:
        self._hand_on(streams, self.place.take_current(streams))

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
            await (self._stream(since) if self._is_streamed else self._poll(since))
        except AgentRefused as why:
            if not why.is_out_of_range:
                raise
            self.place.leave()
            self._begin_at(await self.agent.current())
            await asyncio.sleep(self._every_s)

    async def _poll(self, since: int) -> None:
        streams = await self.agent.sample(since)
        self._hand_on(streams, self.place.take_sample(streams))
        # After a full answer more is there already, and the buffer goes on overwriting the oldest.
        if len(streams.observations) < self.agent.most_at_once or self.place.next_sequence is None:
            await asyncio.sleep(self._every_s)

    async def _stream(self, since: int) -> None:
        async with aclosing(self.agent.stream(since, self._every_s)) as documents:
            async for streams in documents:
                self._hand_on(streams, self.place.take_sample(streams))
                if self.place.next_sequence is None:
                    return
        # The agent ended it, or does not stream: this is then polling.
        await asyncio.sleep(self._every_s)

    def _find(self, items: Sequence[DataItem]) -> None:
        """Find by id or by name what is followed; say what there is not."""
        self._items, self._units = {}, {}
        self._trouble.forget()
        self._trouble.say("")
        by_id: dict[str, list[DataItem]] = {}
        by_name: dict[str, list[DataItem]] = {}
        for data_item in items:
            by_id.setdefault(data_item.item, []).append(data_item)
            by_name.setdefault(data_item.name, []).append(data_item)
        for name, wanted in self._followed.items():
            items_named = by_id.get(wanted.source) or by_name.get(wanted.source, [])
            if len(items_named) != 1:
                why = (
                    "no data item has that"
                    if not items_named
                    else f"{len(items_named)} data items have it"
                )
                self._trouble.say_of(
                    name, f"expected the id or name of one, got {wanted.source!r}: {why}"
                )
            elif wanted.temperature is None or self._choose_unit(
                name, items_named[0].units or None
            ):
                self._items[name] = items_named[0].item

    def _hand_on(self, streams: Streams, observations: Sequence[Observation]) -> None:
        """Hand on what is followed; what cannot be read is missing, and counted."""
        if streams.unnumbered:
            self._trouble.say_of(
                "",
                f"{counted(streams.unnumbered, 'observation')} of the agent had no sequence "
                "number, without which new ones cannot be told from old ones: not read",
            )
        elif observations:
            self._trouble.of.pop("", None)
        names: dict[str, list[str]] = {}
        for name, item in self._items.items():
            names.setdefault(item, []).append(name)
        found = [
            NewValue(name, self._value_of(name, observation))
            for observation in observations
            for name in names.get(observation.item, ())
        ]
        if found:
            self._take(found)

    def _value_of(self, name: str, observation: Observation) -> float | None:
        if observation.value is None:
            self.unreadable += not observation.is_unavailable
            self._trouble.say_of(name, observation.words)
            return None
        return self._converted(name, observation.value)
