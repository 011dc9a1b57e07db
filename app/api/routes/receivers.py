"""Who is told of alarms, and how that went."""

from __future__ import annotations

from typing import Annotated

from fastapi import Path, Request

from app.api.access import sees
from app.api.bodies import BodyRoute
from app.api.dependencies import ContextDep
from app.api.router import Router
from app.services.context import Context
from app.services.tell_receivers import (
    Receiver,
    Receivers,
    ask_for_test_message,
    show_receivers,
)

router = Router(route_class=BodyRoute, prefix="/v1", tags=["events"])

NamePath = Annotated[str, Path(max_length=64, description="Name of the receiver in the file")]


@router.get("/receivers", summary="Who is told of alarms")
def get_receivers(request: Request, context: ContextDep) -> Receivers:
    """List the receivers of the file of connections: what was sent last, what waits, what failed.

    All services on one database say the same. A key for some machines is told of receivers that
    are told of no others.
    """
    return Receivers(tuple(_seen(request, context)))


@router.post("/receivers/{name}/test", summary="Send a test message", status_code=202)
def post_test(request: Request, context: ContextDep, name: NamePath) -> Receiver:
    """Ask for a test message to a receiver.

    The service that has the receiver sends it within seconds: `tested_at` of `GET …/receivers` is
    then after `test_asked_at`, and `test_failure` says why it could not be sent.
    """
    return ask_for_test_message(
        context, name, [receiver.name for receiver in _seen(request, context)]
    )


def _seen(request: Request, context: Context) -> list[Receiver]:
    may_see = sees(request)
    receivers = show_receivers(context).receivers
    if may_see(""):
        return list(receivers)
    return [
        receiver
        for receiver in receivers
        if receiver.machines and all(map(may_see, receiver.machines))
    ]
