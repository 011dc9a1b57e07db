"""`[[mtconnect]]`: an agent, and which of its data items are which sensors of a machine."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Final

import httpx
from pydantic import Field

from app.connections.connection import Table, TemperatureTable, each
from app.connections.follower import FollowedTable, FollowingConnection
from app.connections.intake import TakesValues
from app.connections.known_values import REPEATED_S
from app.services.context import Context

if TYPE_CHECKING:
    from app.connections.mtconnect import AgentFollower

_URL: Final = r"https?://[^\s]+"


class StateItemTable(Table):
    """A data item that a state is read from, in the agent's unit: its id or name."""

    source: Annotated[str, Field(min_length=1, max_length=200, alias="item")]


class ItemTable(TemperatureTable, StateItemTable):
    """A data item that is a temperature."""


class MtconnectTable(FollowedTable):
    """One agent."""

    extra = "mtconnect"
    library = "defusedxml"

    url: Annotated[str, Field(pattern=_URL, max_length=500)]
    sensors: Annotated[dict[str, ItemTable], Field(min_length=1, max_length=200), each("item")]
    state: Annotated[dict[str, StateItemTable], each("item")] = Field(default_factory=dict)
    every_s: float = Field(1.0, ge=0.1, le=3600.0)
    stream: bool = False


class AgentConnection(FollowingConnection):
    """One MTConnect agent, whose values become readings of one machine."""

    kind = "mtconnect"
    _follower: AgentFollower | None = None

    def __init__(
        self, table: MtconnectTable, intake: TakesValues, context: Callable[[], Context]
    ) -> None:
        endpoint = str(httpx.URL(table.url).copy_with(userinfo=b""))
        super().__init__(table, endpoint, intake, context)
        self._table = table

    async def run(self) -> None:
        """Follow the agent until contact is lost."""
        # Imported only here: its library is an extra.
        from app.connections.mtconnect import AgentFollower
        from app.connections.mtconnect_agent import Agent

        table = self._table
        async with httpx.AsyncClient() as http, asyncio.TaskGroup() as tasks:
            agent = Agent(http, table.url)
            if self._follower is None:
                self._follower = AgentFollower(
                    agent, table.followed, self._take, table.every_s, table.stream
                )
            self._follower.agent = agent
            tasks.create_task(self._follower.run())
            tasks.create_task(self._repeat())

    async def _repeat(self) -> None:
        while True:
            await asyncio.sleep(REPEATED_S)
            self._repeat_known()

    def _repeat_known(self) -> None:
        """Tell again what still holds; what the agent has no more, as after a restart, does not."""
        self._known.keep(set() if self._follower is None else self._follower.readable)
        self._known.repeat()
