"""Whether the service is well."""

from __future__ import annotations

from fastapi import Request, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

import app
from app.access.keys import Role
from app.api.access import needs
from app.api.bodies import BodyRoute
from app.api.dependencies import ContextDep
from app.api.machine_metrics import machine_metrics
from app.api.router import Router
from app.api.schemas.health import HealthAnswer, ReadyAnswer
from app.services.machines import without_answer

router = Router(route_class=BodyRoute, tags=["health"])


@router.get("/healthz", summary="Process")
@needs(None)
async def get_healthz() -> HealthAnswer:
    """Answer as long as the process lives."""
    return HealthAnswer(status="ok", version=app.__version__)


@router.get("/readyz", summary="Database and models", responses={503: {"model": ReadyAnswer}})
@needs(None)
async def get_readyz(request: Request, context: ContextDep, response: Response) -> ReadyAnswer:
    """Answer 200 when the database is there and every machine's model is in memory."""
    readiness = await request.app.state.readiness.answer() or without_answer(context)
    response.status_code = 200 if readiness.is_ready else 503
    return ReadyAnswer(
        status="ready" if readiness.is_ready else "not-ready",
        database=readiness.database,
        machines=readiness.machines,
        machines_in_memory=readiness.machines_in_memory,
        disk_free_bytes=readiness.disk_free_bytes,
    )


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
