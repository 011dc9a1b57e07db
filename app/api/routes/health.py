"""Whether the service is well."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fastapi import Request, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest
from pydantic import Field

import app
from app.access.keys import Role
from app.answer import Answer
from app.api.access import needs
from app.api.bodies import BodyRoute
from app.api.dependencies import ContextDep
from app.api.machine_metrics import machine_metrics
from app.api.router import Router
from app.services.machines import Readiness, without_answer

router = Router(route_class=BodyRoute, tags=["health"])


@dataclass(frozen=True, slots=True)
class HealthAnswer(Answer):
    """The process lives."""

    status: Annotated[str, Field(examples=["ok"])]
    """`ok`"""
    version: str
    """Version of thermap"""


@router.get("/healthz", summary="Process")
@needs(None)
async def get_healthz() -> HealthAnswer:
    """Answer as long as the process lives."""
    return HealthAnswer(status="ok", version=app.__version__)


@router.get("/readyz", summary="Database and models", responses={503: {"model": Readiness}})
@needs(None)
async def get_readyz(request: Request, context: ContextDep, response: Response) -> Readiness:
    """Answer 200 when the database is there and every machine's model is in memory."""
    readiness: Readiness = await request.app.state.readiness.answer() or without_answer(context)
    response.status_code = 200 if readiness.is_ready else 503
    return readiness


@router.get("/metrics", summary="Metrics for Prometheus", response_class=Response)
@needs(Role.VIEWER, all_machines=True)
async def get_metrics(request: Request) -> Response:
    """Write counters, latencies and machines' values in Prometheus' text format.

    A verdict is judged when it is asked for. Of more than 1000 machines only the first 1000 by id
    are included. Where the database is slow the machines' values may be left out, which
    `thermap_machine_values_missing` says.
    """
    state = request.app.state
    machines = await state.machine_metrics.answer() or machine_metrics(None)
    own_metrics = generate_latest(state.metrics.registry)
    return Response(own_metrics + machines, media_type=CONTENT_TYPE_LATEST)
