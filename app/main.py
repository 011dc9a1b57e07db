"""The one place that wires things together."""

from __future__ import annotations

import asyncio
import socket
import sys
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from typing import Any

from starlette.concurrency import run_in_threadpool
from starlette.middleware.cors import CORSMiddleware
from starlette.responses import Response
from starlette.staticfiles import StaticFiles

import app as package
from app.access.keys import Role
from app.api.access import AccessControl, needs
from app.api.connection_metrics import connection_metrics, receiver_metrics
from app.api.gate import Gate
from app.api.long_bodies import LongBodies
from app.api.machine_metrics import machine_metrics
from app.api.metrics import Metrics
from app.api.openapi import DESCRIPTION, TAGS, document_problems, swagger_page
from app.api.pages import PAGE_HEADERS, Page
from app.api.routes import (
    controllers,
    dashboard,
    error_maps,
    events,
    files,
    geometry,
    health,
    keys,
    live,
    login,
    loop,
    machines,
    measurements,
    models,
    readings,
    streams,
)
from app.api.service import ThermapService
from app.api.streams import TableStreams
from app.api.turns import SharedQuestion, Turns
from app.connections.config import ConnectionsFile, read_connections
from app.connections.notify_receiver import NotifyReceiver
from app.connections.reports import ConnectionReports
from app.connections.running import Connections
from app.connections.serving_tables import expect_servable, serving_tables
from app.services.access_keys import KeyFollower, KeyRing
from app.services.bin_readings import ReadingBinner
from app.services.context import Context, QueueLimits
from app.services.events import AlarmLog
from app.services.follow_database import DatabaseFollower
from app.services.judge_verifications import LateJudge
from app.services.keep_readings import ReadingKeeper
from app.services.machines import check_readiness
from app.services.run_analyses import make_runner
from app.services.tell_receivers import ReceiverTelling, show_receivers
from app.services.watching_values import shop_values
from app.settings import Settings, is_postgresql, make_own_folder
from app.storage.database import Database
from app.storage.limits import Limits
from app.storage.migrate import Upgraded, upgrade

ROOMS = (
    live,
    streams,
    controllers,
    geometry,
    machines,
    files,
    error_maps,
    measurements,
    models,
    readings,
    loop,
    events,
    keys,
    health,
    dashboard,
    login,
)
"""The routes, in the order in which /docs lists them."""

SWITCH_S = 0.0005
"""How long a thread goes on computing where another one waits for its turn [s].

The loop gives its turn up whenever it reads or sends. Beside a thread that computes it then waited
for Python's 5 ms, several times for each answer.
"""

STOP_S = 2.0
"""How long those who follow the database may take to end [s]: it may hang."""

READY_S = 4.0
"""How long the database may take to say that it is there [s]."""


METRICS_S = 8.0
"""How long the machines' values may take for /metrics [s]: who scrapes waits for 10 s."""


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
    connections_file = (
        ConnectionsFile() if settings.config is None else read_connections(settings.config)
    )
    expect_servable(
        settings.opcua_endpoint, connections_file.opcua_server, insecure=settings.insecure
    )
    context, upgraded = _open_database(settings)
    # The context as it is then: whoever makes the service may give it another clock.
    ring = KeyRing(lambda: service.state.context)
    if settings.asks_for_keys:
        context.database.on_keys_changed = ring.refresh
    keys_follower = KeyFollower(ring, settings.refresh_s)
    follower = DatabaseFollower(context, settings.refresh_s, context.database.on_keys_changed)
    runner = make_runner(context, runs_here=settings.analyses)
    alarms = AlarmLog(context)
    link = _own_address(settings)
    telling = ReceiverTelling(
        context, [NotifyReceiver(receiver, link) for receiver in connections_file.notify]
    )
    judge = LateJudge(context)
    keeper = ReadingKeeper(
        context, settings.keep_readings, settings.thin_readings_after, settings.thin_readings_to_s
    )

    binner = ReadingBinner(context)

    @asynccontextmanager
    async def lifespan(_app: object) -> AsyncIterator[None]:
        sys.setswitchinterval(min(SWITCH_S, sys.getswitchinterval()))
        if settings.asks_for_keys:
            await run_in_threadpool(ring.refresh)  # who asks first has a key, too
            keys_follower.start()
        follower.start()
        runner.start()
        alarms.start()
        telling.start()
        judge.start()
        keeper.start()
        binner.start()
        try:
            async with (
                serving_tables(
                    lambda: service.state.context,
                    settings.opcua_endpoint,
                    connections_file.opcua_server,
                ),
                service.state.connections.running(),
                service.state.connection_reports.running(),
            ):
                yield
        finally:
            # Together: where the database hangs, each takes as long as it may.
            await asyncio.gather(
                run_in_threadpool(keeper.stop, STOP_S),
                run_in_threadpool(binner.stop, STOP_S),
                run_in_threadpool(judge.stop, STOP_S),
                run_in_threadpool(alarms.stop, STOP_S),
                run_in_threadpool(telling.stop, STOP_S),
                run_in_threadpool(keys_follower.stop, STOP_S),
            )
            await run_in_threadpool(runner.stop, STOP_S)
            await run_in_threadpool(follower.stop, STOP_S)
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
        openapi_url=None,
    )
    service.state.context = context
    service.state.runner = runner
    service.state.database_is_new = upgraded.was_empty
    _set_state(service, settings, connections_file, ring)
    _allow_other_sites(service, settings.cors_origins)
    for room in ROOMS:
        room.router.serve_by(service)
    document_problems(service)
    _add_documentation(service)
    return service


def _open_database(settings: Settings) -> tuple[Context, Upgraded]:
    """Open the database, and bring it up to date."""
    make_own_folder(settings.database_url)
    limits = Limits(lock_s=settings.lock_limit_s, statement_s=settings.statement_limit_s)
    waiting = QueueLimits(settings.waiting_analyses_of_machine, settings.waiting_analyses)
    context = Context(Database(settings.database_url, limits), queue_limits=waiting)
    try:
        upgraded = upgrade(context.database)
    except BaseException:
        context.database.close()
        raise
    return context, upgraded


def _set_state(
    service: ThermapService, settings: Settings, connections_file: ConnectionsFile, ring: KeyRing
) -> None:
    """Put what requests share into the service's state, which has its context already."""
    service.state.streams = TableStreams(lambda: service.state.context)
    service.state.long_bodies = LongBodies()
    service.state.turns = Turns(settings.waiting_requests, settings.waiting_limit_s)
    service.state.readiness = SharedQuestion(
        lambda: check_readiness(service.state.context), READY_S
    )
    service.state.machine_metrics = SharedQuestion(
        lambda: (
            machine_metrics(shop_values(service.state.context))
            + connection_metrics(service.state.connection_reports.now, service.state.context.now())
            + receiver_metrics(lambda: show_receivers(service.state.context))
        ),
        METRICS_S,
    )
    service.state.metrics = Metrics(service.state.context.live, settings.worker)
    service.state.gate = Gate(settings.host, settings.allowed_hosts, settings.cors_origins)
    service.state.connections = Connections(
        connections_file, lambda: service.state.context, service.state.streams.all_tables
    )
    service.state.connection_reports = ConnectionReports(
        service.state.connections,
        lambda: service.state.context,
        _name_of_process(settings) if is_postgresql(settings.database_url) else None,
    )
    service.state.access = AccessControl(ring, is_on=settings.asks_for_keys)
    service.state.max_body_bytes = settings.max_body_bytes
    service.state.patience_s = settings.patience_s
    service.state.forwarded_allow_ips = list(settings.forwarded_allow_ips)


def _own_address(settings: Settings) -> str:
    """Guess at which address people reach the service; empty where its port is not known yet."""
    if not settings.port:
        return ""
    names = [name for name in settings.allowed_hosts if "*" not in name]
    is_everywhere = settings.host in ("0.0.0.0", "::", "")
    host = names[0] if names else socket.gethostname() if is_everywhere else settings.host
    bracketed = f"[{host}]" if ":" in host else host
    return f"http://{bracketed}:{settings.port}"


def _allow_other_sites(service: ThermapService, origins: Sequence[str]) -> None:
    """Let pages of other sites read and write, where some are named."""
    if origins:
        service.add_middleware(
            CORSMiddleware,
            allow_origins=origins,
            allow_methods=["GET", "POST", "PUT", "PATCH", "DELETE"],
            allow_headers=["Authorization", "Content-Type", "If-None-Match", "Last-Event-ID"],
            expose_headers=["ETag", "Location", "Retry-After"],
        )


def _name_of_process(settings: Settings) -> str:
    """Name who has the connections of a file, the same after a restart."""
    where = "" if settings.config is None else settings.config.resolve()
    return f"{socket.gethostname()} {where}"[-200:]


class _Files(StaticFiles):
    """Files of installed packages, as what they are said to be."""

    def file_response(self, *args: Any, **named: Any) -> Response:
        """Let no browser guess what a file is."""
        response = super().file_response(*args, **named)
        response.headers.update(PAGE_HEADERS)
        return response


def _add_documentation(service: ThermapService) -> None:
    """Serve /docs and what pages need from installed packages: a shop floor has no internet."""
    service.mount(
        "/docs-assets",
        _Files(packages=[("fastapi_swagger", "resources"), ("plotly", "package_data")]),
        "docs-assets",
    )

    service.mount("/assets", _Files(packages=[("app.pages", "assets")]), "assets")
    for mounted in service.router.routes[-2:]:
        needs(None)(mounted)

    title = service.title  # and not the service, as `openapi_document` says

    @service.get("/docs", include_in_schema=False)
    async def get_docs() -> Page:
        return swagger_page(title)

    needs(Role.VIEWER)(service.router.routes[-1])
