"""The OPC UA server beside the service, where the operator wants one."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from importlib.util import find_spec

from app.errors import InvalidContent
from app.services.context import Context


def expect_library(endpoint: str) -> None:
    """Refuse an endpoint without the library that serves it, which is an extra.

    Raises
    ------
    InvalidContent
        If there is an endpoint, and no asyncua.
    """
    if endpoint and find_spec("asyncua") is None:
        raise InvalidContent(
            f"opcua_endpoint: expected the extra opcua installed for {endpoint!r}, got no asyncua"
        )


@asynccontextmanager
async def serving_tables(context: Callable[[], Context], endpoint: str) -> AsyncIterator[None]:
    """Serve tables over OPC UA for as long as the block lasts; nothing without an endpoint."""
    if not endpoint:
        yield
        return
    # Imported only here: it is an extra, and takes long.
    from app.connections.opcua_server import TableServer

    running = asyncio.create_task(TableServer(context, endpoint).run())
    try:
        yield
    finally:
        running.cancel()
        with suppress(asyncio.CancelledError):
            await running
