"""The one place that wires things together."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from starlette.concurrency import run_in_threadpool
from starlette.responses import HTMLResponse, RedirectResponse
from starlette.staticfiles import StaticFiles

import app as package
from app.api.body_limit import BodyLimitMiddleware
from app.api.error_responses import install_error_responses
from app.api.metrics import Metrics, MetricsMiddleware
from app.api.openapi import DESCRIPTION, TAGS, document_problems, swagger_page
from app.api.routes import compensation, error_maps, health, machines, models, readings
from app.api.short_way import ThermapService
from app.services.context import Context
from app.services.follow_database import DatabaseFollower
from app.settings import Settings
from app.storage.database import Database
from app.storage.migrate import upgrade


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

    @asynccontextmanager
    async def lifespan(_app: object) -> AsyncIterator[None]:
        follower.start()
        try:
            yield
        finally:
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
    service.state.metrics = Metrics(context.live)
    service.add_middleware(BodyLimitMiddleware, max_body_bytes=settings.max_body_bytes)
    service.add_middleware(MetricsMiddleware, metrics=service.state.metrics)
    install_error_responses(service)
    for room in (compensation, machines, error_maps, models, readings, health):
        service.include_router(room.router)
    document_problems(service)
    _add_documentation(service)
    return service


def _add_documentation(service: ThermapService) -> None:
    """Serve /docs from the installed package: a shop floor has no internet."""
    service.mount(
        "/docs-assets", StaticFiles(packages=[("fastapi_swagger", "resources")]), "docs-assets"
    )

    @service.get("/docs", include_in_schema=False)
    async def get_docs() -> HTMLResponse:
        return swagger_page(service.title)

    @service.get("/", include_in_schema=False)
    async def get_root() -> RedirectResponse:
        return RedirectResponse("/docs")
