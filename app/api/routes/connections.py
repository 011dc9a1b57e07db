"""Connections beside HTTP, and how they fare."""

from __future__ import annotations

from dataclasses import replace

from fastapi import Request

from app.api.access import sees
from app.api.bodies import BodyRoute
from app.api.router import Router
from app.connections.running import Connections, ConnectionsNow

router = Router(route_class=BodyRoute, prefix="/v1", tags=["connections"])


@router.get("/connections", summary="How the connections fare")
async def get_connections(request: Request) -> ConnectionsNow:
    """List what the service reads beside HTTP: whether there is contact, and what is the matter.

    The counts are of all connections together, since the service began.
    """
    connections: Connections = request.app.state.connections
    may_see = sees(request)
    now = connections.now()
    seen = tuple(one for one in now.connections if all(map(may_see, one.machines)))
    return (
        now
        if len(seen) == len(now.connections)
        else replace(now, connections=seen, last_refusal="")
    )
