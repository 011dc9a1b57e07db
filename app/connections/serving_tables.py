"""The OPC UA server beside the service, where the operator wants one."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from importlib.util import find_spec
from urllib.parse import urlsplit

from app.connections.opcua_security import OpcuaServerTable
from app.errors import InvalidContent
from app.services.context import Context
from app.settings import is_this_computer
from app.supervision import keep_running


def expect_servable(
    endpoint: str, security: OpcuaServerTable | None = None, *, insecure: bool = False
) -> None:
    """Refuse an endpoint without the library that serves it, or that lets everybody in.

    Raises
    ------
    InvalidContent
        If there is an endpoint, and no asyncua, which is an extra; or if other computers reach it,
        without security and without `insecure`.
    """
    is_open = security is None or security.without_security
    host = urlsplit(endpoint).hostname or ""
    if endpoint and is_open and not (insecure or is_this_computer(host)):
        raise InvalidContent(
            f"opcua_endpoint: expected this computer's own address, as 127.0.0.1, got {host!r}: "
            "other computers read without a key only where --insecure allows it, or with "
            "certificates where [opcua_server] of the file of connections states whom to trust"
        )
    if endpoint and find_spec("asyncua") is None:
        raise InvalidContent(
            f"opcua_endpoint: expected the extra opcua installed for {endpoint!r}, got no asyncua"
        )


@asynccontextmanager
async def serving_tables(
    context: Callable[[], Context], endpoint: str, security: OpcuaServerTable | None = None
) -> AsyncIterator[None]:
    """Serve tables over OPC UA for as long as the block lasts; nothing without an endpoint."""
    if not endpoint:
        yield
        return
    # Imported only here: it is an extra, and takes long.
    from app.connections.opcua_server import TableServer

    server = TableServer(context, endpoint, security)
    running = asyncio.create_task(keep_running("OPC UA server", server.run, server.ended))
    try:
        yield
    finally:
        running.cancel()
        with suppress(asyncio.CancelledError):
            await running
