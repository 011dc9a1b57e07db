"""Tables, verdicts and alarms as retained messages: who comes has them at once."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from contextlib import aclosing
from typing import Final

from pydantic import TypeAdapter
from starlette.concurrency import run_in_threadpool

from app.connections.connection import FollowTables
from app.connections.mqtt_link import BrokerRefused, Link
from app.errors import StorageUnavailable
from app.events.event import Event
from app.services.context import Context
from app.services.events import show_alarms

log = logging.getLogger("thermap")

ALARMS_EVERY_S: Final = 1.0
"""How often the event log is looked at [s]."""

OF_MACHINE: Final = ("table", "status", "alarms")
"""What is retained of each machine."""

_EVENTS: Final = TypeAdapter(list[Event])


class TablePublisher:
    """Publishes below a prefix through one contact; `run` until it is cancelled.

    Of each topic the latest is sent, and the next when the broker has that: where it is slow,
    what lies between is left out.
    """

    def __init__(
        self,
        link: Link,
        prefix: str,
        follow_tables: FollowTables,
        limits: tuple[float, float | None],
        context: Callable[[], Context],
    ) -> None:
        self._link = link
        self._prefix = prefix
        self._follow = follow_tables
        self._limits = limits
        self._context = context
        self._latest: dict[str, bytes] = {}
        self._something = asyncio.Event()
        self._retained: set[str] = set()
        self._alarms: dict[str, bytes] = {}
        self.trouble = ""

    def owns(self, topic: str) -> bool:
        """Whether it is published to; sensors may speak below the prefix, too."""
        above, _, rest = topic.partition(f"{self._prefix}/")
        machine, _, what = rest.rpartition("/")
        return not above and (rest == "state" or bool(machine and what in OF_MACHINE))

    def note(self, topic: str) -> None:
        """Note that something is retained, as of a machine that was deleted meanwhile."""
        machine, _, what = topic.removeprefix(f"{self._prefix}/").rpartition("/")
        if machine and what in OF_MACHINE:
            self._retained.add(machine)

    def ended(self, words: str) -> None:
        """Take note of why nothing was published for a while."""
        log.warning("MQTT: tables are published anew: %s", words)
        self.trouble = f"tables could not be published: {words}"

    async def run(self) -> None:
        """Publish; LinkLost where contact ends."""
        self.trouble = ""
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._send())
            self._put("state", b"online")
            tasks.create_task(self._tell_tables())
            await self._link.retained(f"{self._prefix}/+/+")
            tasks.create_task(self._tell_alarms())

    async def _tell_tables(self) -> None:
        async with aclosing(self._follow(*self._limits)) as events:
            async for event in events:
                what = "status" if event.kind == "status" else "table"
                self._retained.add(event.machine)
                self._put(f"{event.machine}/{what}", event.content)

    async def _tell_alarms(self) -> None:
        while True:
            try:
                alarms = await run_in_threadpool(show_alarms, self._context())
            except StorageUnavailable:
                pass  # what was told holds until more is known
            else:
                self._compare(alarms)
            await asyncio.sleep(ALARMS_EVERY_S)

    def _compare(self, alarms: dict[str, list[Event]]) -> None:
        """Tell alarms that are new; of machines that are gone nothing is left."""
        for machine, events in alarms.items():
            content = alarms_json(machine, events)
            if self._alarms.get(machine) != content:
                self._alarms[machine] = content
                self._retained.add(machine)
                self._put(f"{machine}/alarms", content)
        for machine in self._retained - alarms.keys():
            self._retained.discard(machine)
            self._alarms.pop(machine, None)
            for what in OF_MACHINE:
                self._put(f"{machine}/{what}", b"")

    def _put(self, topic: str, content: bytes) -> None:
        self._latest[topic] = content
        self._something.set()

    async def _send(self) -> None:
        while True:
            await self._something.wait()
            self._something.clear()
            while self._latest:
                # The oldest first, and taken out before it is sent: what is put meanwhile stands
                # behind the others, and is sent as well.
                topic = next(iter(self._latest))
                content = self._latest.pop(topic)
                try:
                    await self._link.publish(f"{self._prefix}/{topic}", content, retain=True)
                except BrokerRefused as why:
                    if not self.trouble:
                        log.warning("MQTT: %s", why.detail)
                    self.trouble = why.detail


def alarms_json(machine: str, events: Sequence[Event]) -> bytes:
    """Write what lasts of a machine."""
    name = TypeAdapter(str).dump_json(machine)
    return b'{"machine":%b,"alarms":%b}' % (name, _EVENTS.dump_json(list(events)))
