"""`[[opcua]]`: a server, and which of its nodes are which sensors of a machine."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from datetime import datetime
from typing import TYPE_CHECKING, Annotated, Final

from pydantic import Field

from app.connections.connection import (
    Connection,
    ConnectionTable,
    ShortName,
    Table,
    TemperatureTable,
    each,
)
from app.connections.intake import TakesValues
from app.connections.known_values import REPEATED_S, KnownValues
from app.connections.opcua_security import SecurityTable, UserTable
from app.services.context import Context

if TYPE_CHECKING:
    from app.connections.opcua_client import Found, ServerFollower
    from app.connections.opcua_session import Access, Security

log = logging.getLogger("thermap")

_ENDPOINT: Final = r"^opc\.tcp://[^\s@]+$"

_NODE: Final = r"^((ns=\d+;)?(i=\d+|[sgb]=.+)|nsu=[^;]+;(i=\d+|[sgb]=.+))$"


class StateNodeTable(Table):
    """A node that a state is read from, in the server's unit."""

    node: Annotated[str, Field(pattern=_NODE, max_length=500)]


class NodeTable(TemperatureTable, StateNodeTable):
    """A node that is a temperature."""


class OpcuaTable(ConnectionTable):
    """One server."""

    extra = "opcua"
    library = "asyncua"

    machine: ShortName
    endpoint: Annotated[str, Field(pattern=_ENDPOINT, max_length=500)]
    sensors: Annotated[dict[str, NodeTable], Field(min_length=1, max_length=200), each("node")]
    state: Annotated[dict[str, StateNodeTable], Field(max_length=200), each("node")] = Field(
        default_factory=dict
    )
    publishing_s: float = Field(1.0, ge=0.1, le=60.0)
    security: SecurityTable | None = None
    user: UserTable | None = None

    @property
    def access(self) -> Access:
        """Where the server is and who asks it, with the password as it is now."""
        from app.connections.opcua_session import Access, Security

        security: Security | None = None
        if self.security is not None:
            security = Security(**self.security.model_dump())
        if self.user is None:
            return Access(self.endpoint, security)
        return Access(self.endpoint, security, self.user.name, self.user.password)

    def expect_usable(self) -> None:
        """Refuse files that are no certificates; ValueError."""
        if self.security is not None:
            self.security.expect_usable()


class ServerConnection:
    """One OPC UA server, whose values become readings of one machine."""

    def __init__(
        self, table: OpcuaTable, intake: TakesValues, context: Callable[[], Context]
    ) -> None:
        self._table = table
        self._context = context
        self._known = KnownValues(intake, table.machine, table.sensors, table.state)
        self._last_value_at: datetime | None = None
        self._follower: ServerFollower | None = None

    async def run(self) -> None:
        """Follow the server until contact is lost."""
        # Imported only here: its library is an extra, and takes long.
        from app.connections.opcua_client import Followed, ServerFollower

        table = self._table
        followed = {name: Followed(one.node, one) for name, one in table.sensors.items()}
        followed |= {name: Followed(one.node, None) for name, one in table.state.items()}
        if self._follower is None:
            self._follower = ServerFollower(
                table.access,
                followed,
                self._take,
                lambda: self._context().now(),
                publishing_s=table.publishing_s,
                repeated_s=REPEATED_S,
            )
            if table.user is not None and table.security is None:
                log.warning(
                    "OPC UA %s: without security the password may cross the network for all to "
                    "read",
                    table.endpoint,
                )
        await self._follower.run()

    def lost(self, words: str) -> None:
        """Take note of why there is no contact."""
        if self._follower is not None:
            self._follower.lost(words)

    def now(self) -> Connection:
        """Say how it fares."""
        follower = self._follower
        return Connection(
            name=self._table.name,
            kind="opcua",
            machines=(self._table.machine,),
            endpoint=self._table.endpoint,
            connected=follower is not None and follower.is_connected,
            last_value_at=self._last_value_at,
            known=len(self._known),
            trouble="" if follower is None else follower.trouble,
            lost=0,
        )

    def _take(self, found: Sequence[Found]) -> None:
        """Remember what holds from now on; without contact nothing is known any more."""
        if not found:
            self._known.forget()
            return
        if any(one.value is not None for one in found):
            self._last_value_at = self._context().now()
        for time in sorted({one.time for one in found}, key=lambda time: (time is None, time)):
            self._known.take({one.name: one.value for one in found if one.time == time}, time)
