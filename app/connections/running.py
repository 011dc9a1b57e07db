"""The connections while the service runs: started with it, ended with it, and how each fares."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from typing import TYPE_CHECKING, Final

import httpx

from app.answer import Answer
from app.connections.config import ConnectionsFile, MtconnectTable
from app.connections.intake import Intake
from app.services.context import Context

if TYPE_CHECKING:
    from app.connections.mtconnect import AgentFollower, Found

REPEATED_S: Final = 10.0
"""What has not changed is stored again after so long [s]: an agent tells changes only, and a
temperature that nobody tells of any more grows stale."""


@dataclass(frozen=True, slots=True)
class Connection(Answer):
    """A connection and how it fares."""

    name: str
    """Its name in the file"""
    kind: str
    """`mtconnect`"""
    machine: str
    """Id of the machine whose sensors it reads"""
    endpoint: str
    """Where it reads"""
    connected: bool
    """Whether there is contact now"""
    last_value_at: datetime | None
    """When the last value came, null before the first"""
    known: int
    """How many of its sensors and states have a value now"""
    trouble: str
    """What is the matter, empty where nothing"""
    lost: int
    """Observations that the agent had thrown away before they were read"""


@dataclass(frozen=True, slots=True)
class ConnectionsNow(Answer):
    """All connections, and what became of what they read."""

    connections: tuple[Connection, ...]
    """The connections, in the order of the file"""
    stored: int
    """Readings that were stored since the service began"""
    dropped: int
    """Readings that were dropped, the oldest first, as too many waited for the database"""
    refused: int
    """Values or readings that were refused"""
    last_refusal: str
    """The last of these, and why; empty without any"""


class AgentConnection:
    """One MTConnect agent, whose values become readings of one machine."""

    def __init__(
        self, table: MtconnectTable, intake: Intake, context: Callable[[], Context]
    ) -> None:
        self._table = table
        self._intake = intake
        self._context = context
        self._known: dict[str, float] = {}
        self._last_value_at: datetime | None = None
        self._follower: AgentFollower | None = None

    async def run(self) -> None:
        """Follow the agent until cancelled."""
        # Imported only here: its library is an extra.
        from app.connections.mtconnect import AgentFollower, Followed
        from app.connections.mtconnect_agent import Agent

        table = self._table
        followed = {name: Followed(i.item, True, i.unit) for name, i in table.sensors.items()}
        followed |= {name: Followed(i.item, False) for name, i in table.state.items()}
        async with httpx.AsyncClient() as http, asyncio.TaskGroup() as tasks:
            agent = Agent(http, table.url)
            self._follower = AgentFollower(agent, followed, self._take, table.every_s, table.stream)
            tasks.create_task(self._follower.run())
            tasks.create_task(self._repeat())

    def now(self) -> Connection:
        """Say how it fares."""
        follower = self._follower
        return Connection(
            name=self._table.name,
            kind="mtconnect",
            machine=self._table.machine,
            endpoint=str(httpx.URL(self._table.url).copy_with(userinfo=b"")),
            connected=follower is not None and follower.is_connected,
            last_value_at=self._last_value_at,
            known=len(self._known),
            trouble="" if follower is None else follower.trouble,
            lost=0 if follower is None else follower.place.lost,
        )

    async def _take(self, found: Sequence[Found]) -> None:
        """Remember what holds from now on; without contact nothing is known any more."""
        if not found:
            self._known.clear()
            return
        for one in found:
            if one.value is None:
                self._known.pop(one.name, None)
            else:
                self._known[one.name] = one.value
                self._last_value_at = self._context().now()
        self._offer({one.name for one in found})

    async def _repeat(self) -> None:
        while True:
            await asyncio.sleep(REPEATED_S)
            self._repeat_known()

    def _repeat_known(self) -> None:
        """Tell again what still holds; what the agent has no more, as after a restart, does not."""
        readable = set() if self._follower is None else self._follower.readable
        self._known = {name: value for name, value in self._known.items() if name in readable}
        self._offer(set(self._known))

    def _offer(self, names: set[str]) -> None:
        """Hand over what is known of these, with the state that holds with it."""
        temperatures_c = {k: v for k, v in self._known.items() if k in self._table.sensors}
        state = {k: v for k, v in self._known.items() if k in self._table.state}
        changed = {k: v for k, v in temperatures_c.items() if k in names}
        if changed or (state and names & state.keys()):
            # The rest is told again after `REPEATED_S`, so that a reading has what changed.
            self._intake.offer(self._table.machine, changed, state=state)


class Connections:
    """All connections of the service."""

    def __init__(self, stated: ConnectionsFile, context: Callable[[], Context]) -> None:
        self._intake = Intake(context, stated.intake.limits) if stated.mtconnect else None
        self._agents = [
            AgentConnection(table, self._intake, context)
            for table in stated.mtconnect
            if self._intake is not None
        ]

    def now(self) -> ConnectionsNow:
        """Say how all fare."""
        found = tuple(agent.now() for agent in self._agents)
        if self._intake is None:
            return ConnectionsNow(found, 0, 0, 0, "")
        counts = self._intake.counts
        return ConnectionsNow(
            found, counts.stored, counts.dropped, counts.refused, counts.last_refusal
        )

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Run for as long as the block lasts: an agent that is gone keeps nobody from starting."""
        if self._intake is None:
            yield
            return
        tasks = [asyncio.create_task(self._intake.run())]
        tasks += [asyncio.create_task(agent.run()) for agent in self._agents]
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()
            with suppress(asyncio.CancelledError):
                await asyncio.gather(*tasks, return_exceptions=True)
