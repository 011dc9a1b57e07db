"""The one place that wires things together."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import Depends
from starlette.concurrency import run_in_threadpool
from starlette.responses import HTMLResponse, RedirectResponse
from starlette.staticfiles import StaticFiles

import app as package
from app.api.body_limit import BodyLimitMiddleware
from app.api.dependencies import refuse_unknown_query
from app.api.error_responses import install_error_responses
from app.api.metrics import Metrics, MetricsMiddleware
from app.api.openapi import DESCRIPTION, TAGS, document_problems, swagger_page
from app.api.routes import (
    analyses,
    compensation,
    error_maps,
    geometry,
    health,
    machines,
    measurements,
    models,
    pictures,
    readings,
    residuals,
    verifications,
)
from app.api.short_way import ThermapService
from app.services.context import Context
from app.services.follow_database import DatabaseFollower
from app.services.run_analyses import AnalysisRunner
from app.settings import Settings
from app.storage.database import Database
from app.storage.migrate import upgrade

ROOMS = (
    compensation,
    geometry,
    pictures,
    machines,
    error_maps,
    measurements,
    models,
    readings,
    verifications,
    residuals,
    analyses,
    health,
)
"""The routes, in the order in which /docs lists them."""


def create_app(settings: Settings | None = None) -> ThermapService:
    """Make the service: database upgraded, routes in place, memory filled at start-up.

    Raises
    ------
    StorageTooNew
        If the database was written by a newer version.
    StorageUnavailable
        If the database cannot be reached.
    """
    settings = settings or Settings()
    context = Context(Database(settings.database_url))
    try:
        upgrade(context.database)
    except BaseException:
        context.database.close()
        raise
    follower = DatabaseFollower(context, settings.refresh_s)
    runner = AnalysisRunner(context)

    @asynccontextmanager
    async def lifespan(_app: object) -> AsyncIterator[None]:
        follower.start()
        runner.start()
        try:
            yield
        finally:
            await run_in_threadpool(runner.stop)
            await run_in_threadpool(follower.stop)
            context.database.close()

    service = ThermapService(
        title="thermap",
        version=package.__version__,
        summary="Thermal error maps of machine tools, and the compensation table "
        "for live temperatures",
        description=DESCRIPTION,
        openapi_tags=TAGS,
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
    )
    service.state.context = context
    service.state.runner = runner
    service.state.metrics = Metrics(context.live)
    service.add_middleware(BodyLimitMiddleware, max_body_bytes=settings.max_body_bytes)
    service.add_middleware(MetricsMiddleware, metrics=service.state.metrics)
    install_error_responses(service)
    for room in ROOMS:
        service.include_router(room.router, dependencies=[Depends(refuse_unknown_query)])
    document_problems(service)
    _add_documentation(service)
    return service


def _add_documentation(service: ThermapService) -> None:
    """Serve /docs and what pages need from installed packages: a shop floor has no internet."""
    service.mount(
        "/docs-assets",
        StaticFiles(packages=[("fastapi_swagger", "resources"), ("plotly", "package_data")]),
        "docs-assets",
    )

    @service.get("/docs", include_in_schema=False)
    async def get_docs() -> HTMLResponse:
        return swagger_page(service.title)

    @service.get("/", include_in_schema=False)
    async def get_root() -> RedirectResponse:
        return RedirectResponse("/docs")
