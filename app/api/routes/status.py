"""Whether machines can be trusted now."""

from __future__ import annotations

from fastapi import Request

from app.api.access import sees
from app.api.bodies import BodyRoute
from app.api.dependencies import ContextDep, MachinePath
from app.api.router import Router
from app.services.status import show_status, show_statuses
from app.status.machine_status import MachineStatus

router = Router(route_class=BodyRoute, prefix="/v1", tags=["live"])


@router.get("/status", summary="Whether the machines can be trusted now")
def get_statuses(request: Request, context: ContextDep) -> list[MachineStatus]:
    """Give every machine's verdict, by id: what it rests on, why not, and how large it may be."""
    may_see = sees(request)
    return [status for status in show_statuses(context) if may_see(status.machine)]


@router.get("/machines/{machine}/status", summary="Whether a machine can be trusted now")
def get_status(context: ContextDep, machine: MachinePath) -> MachineStatus:
    """Give one machine's verdict.

    Pages, streams and the command line repeat it word for word; it is judged here alone.
    """
    return show_status(context, machine)
