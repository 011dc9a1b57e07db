"""Connections beside HTTP, and how they fare."""

from __future__ import annotations

from dataclasses import replace

from fastapi import Request

from app.api.access import sees
from app.api.bodies import BodyRoute
from app.api.router import Router
from app.connections.reports import ConnectionReports
from app.connections.running import ConnectionsNow

router = Router(route_class=BodyRoute, prefix="/v1", tags=["connections"])


@router.get("/connections", summary="How the connections fare")
def get_connections(request: Request) -> ConnectionsNow:
    """List what the service reads beside HTTP: whether there is contact, and what is the matter.

    Of several workers, or several services on one PostgreSQL database, all say the same within a
    second or two. The counts below the list are of all connections together, since their service
    began.
    """
    reports: ConnectionReports = request.app.state.connection_reports
    may_see = sees(request)
    now = reports.now()
    seen = tuple(
        connection for connection in now.connections if all(map(may_see, connection.machines))
    )
    clocks = tuple(filter(may_see, now.machines_with_wrong_clocks))
    words = now.last_refusal if len(seen) == len(now.connections) else ""
    return replace(now, connections=seen, last_refusal=words, machines_with_wrong_clocks=clocks)
