"""Whether the service is well."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest
from pydantic import Field

import app
from app.api.dependencies import ContextDep
from app.api.schemas.base import Schema
from app.services.check_readiness import check_readiness

router = APIRouter(tags=["health"])


class HealthAnswer(Schema):
    """The process lives."""

    status: str = Field(description="`ok`", examples=["ok"])
    version: str = Field(description="Version of thermap")


class ReadyAnswer(Schema):
    """Whether the database is there and the models are in memory."""

    status: str = Field(description="`ready` or `not-ready`", examples=["ready"])
    database: str = Field(description="`ok`, or what is the matter")
    machines: int = Field(description="Machines in the database")
    machines_in_memory: int = Field(description="Machines whose model is in memory")


@router.get("/healthz", summary="Process")
async def get_healthz() -> HealthAnswer:
    """Answer as long as the process lives."""
    return HealthAnswer(status="ok", version=app.__version__)


@router.get("/readyz", summary="Database and models", responses={503: {"model": ReadyAnswer}})
def get_readyz(context: ContextDep, response: Response) -> ReadyAnswer:
    """Answer 200 when the database is there and every machine's model is in memory."""
    readiness = check_readiness(context)
    response.status_code = 200 if readiness.is_ready else 503
    return ReadyAnswer(
        status="ready" if readiness.is_ready else "not-ready",
        database=readiness.database,
        machines=readiness.machines,
        machines_in_memory=readiness.machines_in_memory,
    )


@router.get("/metrics", summary="Metrics for Prometheus", response_class=Response)
def get_metrics(request: Request) -> Response:
    """Write counters and latencies in Prometheus' text format."""
    registry = request.app.state.metrics.registry
    return Response(generate_latest(registry), media_type=CONTENT_TYPE_LATEST)
