"""The connections while the service runs: started with it, ended with it, and how each fares."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, replace
from typing import Final

from app.answer import Answer
from app.connections.config import ConnectionsFile
from app.connections.connection import (
    Connection,
    FollowTables,
    RunningConnection,
    TellsTables,
)
from app.connections.intake import Fate, Intake, Sender, TakesValues
from app.connections.mqtt_tables import MqttTable
from app.connections.mtconnect_connection import AgentConnection, MtconnectTable
from app.connections.opcua_connection import OpcuaTable, ServerConnection
from app.foreign_text import shown, without_secrets
from app.services.context import Context
from app.supervision import keep_running

LONGEST_TROUBLE: Final = 2000
"""Of what is said of one connection [characters]."""


@dataclass(frozen=True, slots=True)
class ConnectionsNow(Answer):
    """All connections, and what became of what they read."""

    connections: tuple[Connection, ...]
    """The connections, kind by kind in the order of the file"""
    stored: int
    """Readings that were stored since the service began"""
    dropped: int
    """Readings that were dropped, the oldest first, as too many waited for the database"""
    refused: int
    """Values or readings that were refused"""
    last_refusal: str
    """The last of these, and why; empty without any"""
    wrong_clocks: int = 0
    """Values with a time of their sender that was more than 5 s off the service's clock"""
    machines_with_wrong_clocks: tuple[str, ...] = ()
    """Machines of whose senders one stated such a time within the last minute"""


class Connections:
    """All connections of the service."""

    def __init__(
        self,
        connections_file: ConnectionsFile,
        context: Callable[[], Context],
        follow_tables: FollowTables,
    ) -> None:
        self._intake = Intake(context, connections_file.intake.limits)
        self._connections: list[tuple[Sender, RunningConnection]] = []
        for table in connections_file.connections:
            sender = Sender(self._intake)
            connection = _connection(table, sender, context)
            if isinstance(connection, TellsTables):
                connection.follow_tables = follow_tables
            self._connections.append((sender, connection))

    def __bool__(self) -> bool:
        """Whether there are any."""
        return bool(self._connections)

    def now(self) -> ConnectionsNow:
        """Say how all fare."""
        counts = self._intake.counts
        return ConnectionsNow(
            tuple(
                _with_counts(connection.now(), sender) for sender, connection in self._connections
            ),
            counts.stored,
            counts.dropped,
            counts.refused,
            counts.last_refusal,
            counts.wrong_clocks,
            self._intake.machines_with_wrong_clocks,
        )

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Run for as long as the block lasts: who is gone keeps nobody from starting."""
        if not self._connections:
            yield
            return
        tasks = [
            asyncio.create_task(keep_running("what connections read", self._intake.run)),
            *(
                asyncio.create_task(
                    keep_running(connection.now().name, connection.run, connection.lost)
                )
                for _, connection in self._connections
            ),
        ]
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()
            with suppress(asyncio.CancelledError):
                await asyncio.gather(*tasks, return_exceptions=True)
            self._intake.end()


def _connection(
    table: MtconnectTable | OpcuaTable | MqttTable,
    intake: TakesValues,
    context: Callable[[], Context],
) -> RunningConnection:
    match table:
        case MtconnectTable():
            return AgentConnection(table, intake, context)
        case OpcuaTable():
            return ServerConnection(table, intake, context)
        case MqttTable():
            # Imported only here: its library is an extra.
            from app.connections.mqtt_connection import MqttConnection

            return MqttConnection(table, intake, context)


def _with_counts(now: Connection, sender: Sender) -> Connection:
    fates = sender.fates
    return replace(
        now,
        trouble=shown("; ".join(filter(None, [now.trouble, *sender.troubles])), LONGEST_TROUBLE),
        endpoint=without_secrets(now.endpoint),
        taken=fates[Fate.STORED],
        dropped=fates[Fate.DROPPED],
        refused=fates[Fate.REFUSED],
    )
