"""`[[opcua]]`: a server, and which of its nodes are which sensors of a machine."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Final

from pydantic import Field

from app.connections.connection import Table, TemperatureTable, each
from app.connections.follower import FollowedTable, FollowingConnection
from app.connections.intake import TakesValues
from app.connections.known_values import REPEATED_S
from app.connections.opcua_security import SecurityTable, UserTable
from app.services.context import Context

if TYPE_CHECKING:
    from app.connections.opcua_client import ServerFollower
    from app.connections.opcua_session import Access

log = logging.getLogger("thermap")

_ENDPOINT: Final = r"^opc\.tcp://[^\s@]+$"

_NODE: Final = r"^((ns=\d+;)?(i=\d+|[sgb]=.+)|nsu=[^;]+;(i=\d+|[sgb]=.+))$"


class StateNodeTable(Table):
    """A node that a state is read from, in the server's unit."""

    source: Annotated[str, Field(pattern=_NODE, max_length=500, alias="node")]


class NodeTable(TemperatureTable, StateNodeTable):
    """A node that is a temperature."""


class OpcuaTable(FollowedTable):
    """One server."""

    extra = "opcua"
    library = "asyncua"

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
        from app.connections.opcua_session import Access

        if self.user is None:
            return Access(self.endpoint, self.security)
        return Access(self.endpoint, self.security, self.user.name, self.user.password)

    def expect_usable(self) -> None:
        """Refuse files that are no certificates; ValueError."""
        if self.security is not None:
            self.security.expect_usable()


class ServerConnection(FollowingConnection):
    """One OPC UA server, whose values become readings of one machine."""

    kind = "opcua"
    _follower: ServerFollower | None = None

    def __init__(
        self, table: OpcuaTable, intake: TakesValues, context: Callable[[], Context]
    ) -> None:
        super().__init__(table, table.endpoint, intake, context)
        self._table = table

    async def run(self) -> None:
        """Follow the server until contact is lost."""
        # Imported only here: its library is an extra, and takes long.
        from app.connections.opcua_client import ServerFollower

        table = self._table
        if self._follower is None:
            self._follower = ServerFollower(
                table.access,
                table.followed,
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
