"""The dashboard: pages for people. What they show is what the API answers."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import Path, Query, Request
from starlette.responses import JSONResponse, Response

from app.access.keys import Role
from app.api.access import needs, sees
from app.api.bodies import BodyRoute
from app.api.dependencies import (
    ContextDep,
    FleetQuestionQuery,
    MachinePath,
    MapPath,
    VerificationPath,
    VersionPath,
)
from app.api.methods.registry import TITLES
from app.api.pages import LivePage, take_reader
from app.api.router import Router
from app.api.routes.events import BeforeQuery
from app.connections.reports import ConnectionReports
from app.controllers.registry import format_named
from app.events.event import EventKind
from app.pages.dashboard.compared_residuals import compared_residuals
from app.pages.dashboard.events import events_page
from app.pages.dashboard.export import export_page
from app.pages.dashboard.fleet import fleet_page
from app.pages.dashboard.history import history_page
from app.pages.dashboard.loop import left_of_check, loop_page
from app.pages.dashboard.maps import activation_preview, maps_page, withdrawal_preview
from app.pages.dashboard.pages import machine_page, machines_page
from app.pages.dashboard.setup import Source, new_machine_page, setup_page
from app.pages.dashboard.stored import stored_check_page, stored_map_page
from app.pages.dashboard.volume import volume_page
from app.pages.wording import said_as_a_whole
from app.services.controllers import writable_components
from app.services.dashboard import show_machine_view, show_machine_views, show_maps_view, show_setup
from app.services.error_maps import preview_withdrawal
from app.services.events import show_events
from app.services.fleet import show_fleet
from app.services.loop import show_compared_checks, show_left_of_check, show_loop
from app.services.machines import show_error_map, show_machine
from app.services.models import preview_activation
from app.services.status import show_status
from app.services.tell_receivers import show_receivers
from app.services.verifications import show_verification
from app.services.volume import show_volume


async def _for_the_reader(request: Request) -> None:
    """Let pages be written as their reader wants them."""
    take_reader(request)


Texts = Annotated[list[Annotated[str, Query(max_length=2000)]], Query(max_length=30)]

router = Router(
    read_first=_for_the_reader,
    route_class=BodyRoute,
    default_response_class=LivePage,
    include_in_schema=False,
)

_HEADERS = {"Cache-Control": "no-store"}

Chosen = Annotated[str, Query(max_length=16)]


@router.get("/")
def get_machines(
    request: Request,
    context: ContextDep,
    only: Literal["", "not-trusted", "limited", "service", "trusted"] = "",
) -> str:
    """Show all machines: who can be trusted, who cannot and why."""
    may_see = sees(request)
    views = [view for view in show_machine_views(context) if may_see(view.status.machine)]
    return machines_page(views, context.now(), only, context.live.database.trouble)


@router.get("/new-machine")
def get_new_machine(context: ContextDep) -> str:
    """Show the form by which a machine is made."""
    return new_machine_page(context.now())


@router.get("/machines/{machine}/setup")
def get_setup(request: Request, context: ContextDep, machine: MachinePath) -> str:
    """Show a machine's set-up: what is there, what is missing, and what comes next."""
    view = show_setup(context, machine)
    reports: ConnectionReports = request.app.state.connection_reports
    sources = [
        Source(connection.name, connection.connected, connection.trouble)
        for connection in reports.now().connections
        if machine in connection.machines
    ]
    return setup_page(view, sources, context.now(), TITLES)


@router.get("/machines/{machine}")
def get_machine(
    context: ContextDep, machine: MachinePath, x: Chosen = "", y: Chosen = "", z: Chosen = ""
) -> str:
    """Show one machine now; `x`, `y` and `z` name the components that are drawn large."""
    view = show_machine_view(context, machine)
    chosen = {"x": x, "y": y, "z": z}
    return machine_page(view, context.now(), chosen)


@router.get("/fleet")
@needs(Role.VIEWER, all_machines=True)
def get_fleet(context: ContextDep, question: FleetQuestionQuery) -> str:
    """Show how far the analyses of all machines are, and what they say together.

    The address says what is asked, as of `GET /v1/fleet`.
    """
    view = show_fleet(context, question)
    return fleet_page(view, context.now(), question)


@router.get("/said")
async def get_said(text: Texts) -> JSONResponse:
    """Say texts of the service as pages do; null for one that is not recognised."""
    return JSONResponse([said_as_a_whole(one) for one in text], headers=_HEADERS)


@router.get("/favicon.ico")
@needs(None)
async def get_icon() -> Response:
    """Say that there is no icon: browsers ask for one beside pages that name none."""
    return Response(status_code=204, headers={"Cache-Control": "max-age=86400"})


VersionNumber = Annotated[int | None, Query(ge=1, le=2**31 - 1)]
ToolOffset = Annotated[float, Query(ge=-1e5, le=1e5, allow_inf_nan=False)]


@router.get("/machines/{machine}/volume")
def get_volume(
    context: ContextDep,
    machine: MachinePath,
    times: Annotated[float | None, Query(gt=0, allow_inf_nan=False)] = None,
    through: Literal["worst", "middle"] = "worst",
    tool_x: ToolOffset = 0.0,
    tool_y: ToolOffset = 0.0,
    tool_z: ToolOffset = 0.0,
) -> str:
    """Show the work volume now; `times` is the exaggeration, `tool_x` … the tool offset [mm]."""
    view = show_volume(context, machine, (tool_x, tool_y, tool_z), times, through)
    return volume_page(view, context.now())


@router.get("/machines/{machine}/loop")
def get_loop(
    context: ContextDep,
    machine: MachinePath,
    analysis: Annotated[int | None, Query(description="The analysis' number")] = None,
) -> str:
    """Show a machine's checks, and what an analysis of them found; the newest if none is stated."""
    view = show_loop(context, machine, analysis)
    return loop_page(view, context.now(), TITLES)


@router.get("/machines/{machine}/loop/residuals/{verification}")
def get_left_of_check(
    context: ContextDep,
    machine: MachinePath,
    verification: Annotated[int, Path(ge=1, le=2**31 - 1)],
) -> str:
    """Show what the active version leaves of a check, as a part of the page of the loop.

    That nothing of it can be compared is an answer here, and no error.
    """
    remaining = show_left_of_check(context, machine, verification)
    return left_of_check(remaining)


@router.get("/machines/{machine}/export")
def get_export(
    context: ContextDep,
    machine: MachinePath,
    controller: Annotated[str | None, Query(max_length=100)] = None,
) -> str:
    """Show what a controller's files would be; `controller` names its format."""
    status = show_status(context, machine)
    chosen = None if controller is None else format_named(controller)
    writable = () if chosen is None else writable_components(context, machine, chosen)
    return export_page(status, chosen, writable, context.now())


@router.get("/machines/{machine}/maps")
def get_maps(
    context: ContextDep, machine: MachinePath, a: VersionNumber = None, b: VersionNumber = None
) -> str:
    """Show a machine's versions; `a` and `b` are the two that stand side by side."""
    view = show_maps_view(context, machine, a, b)
    return maps_page(view, context.now(), TITLES)


@router.get("/machines/{machine}/maps/residuals")
def get_compared_residuals(
    context: ContextDep,
    machine: MachinePath,
    a: Annotated[int, Query(ge=1, le=2**31 - 1)],
    b: Annotated[int, Query(ge=1, le=2**31 - 1)],
) -> str:
    """Show what two versions leave of the same checks, as a part of the page of maps."""
    compared = show_compared_checks(context, machine, a, b)
    return compared_residuals(compared, machine, context.now())


@router.get("/machines/{machine}/maps/preview/{version}")
def get_activation_preview(context: ContextDep, machine: MachinePath, version: VersionPath) -> str:
    """Show what activating a version would do, as a part of the page of maps."""
    preview = preview_activation(context, machine, version)
    return activation_preview(preview, version)


@router.get("/machines/{machine}/maps/withdrawal/{map_id}")
def get_withdrawal_preview(
    context: ContextDep, machine: MachinePath, map_id: Annotated[int, Path(ge=1, le=2**31 - 1)]
) -> str:
    """Show what taking a map out of use would do, as a part of the page of maps."""
    stored, _ = show_error_map(context, machine, map_id)
    preview = preview_withdrawal(context, machine, map_id)
    return withdrawal_preview(preview, stored)


@router.get("/machines/{machine}/history")
def get_history(context: ContextDep, machine: MachinePath) -> str:
    """Show a machine over time; the address says what and when, for the page's own script."""
    view = show_machine_view(context, machine)
    return history_page(view, context.now())


@router.get("/machines/{machine}/maps/{map_id}")
def get_stored_map(context: ContextDep, machine: MachinePath, map_id: MapPath) -> str:
    """Show one stored map: what was measured, drawn, and to be downloaded."""
    stored, in_use = show_error_map(context, machine, map_id)
    described = show_machine(context, machine).machine
    return stored_map_page(described, stored, context.now(), in_use=in_use)


@router.get("/machines/{machine}/loop/checks/{verification_id}")
def get_stored_check(
    context: ContextDep, machine: MachinePath, verification_id: VerificationPath
) -> str:
    """Show one stored check, as it was measured."""
    _, check = show_verification(context, machine, verification_id)
    described = show_machine(context, machine).machine
    return stored_check_page(described, verification_id, check, context.now())


@router.get("/machines/{machine}/events")
def get_events(
    context: ContextDep,
    machine: MachinePath,
    kind: Literal[
        "", "alarm", "sensor", "model", "verification", "analysis", "readings", "machine"
    ] = "",
    before: BeforeQuery = None,
) -> str:
    """Show what happened to a machine; `kind` holds the list to one, `before` goes on in it."""
    status = show_status(context, machine)
    kinds = [EventKind(kind)] if kind else []
    events = show_events(context, machine, kinds=kinds, before=before, limit=100)
    receivers = show_receivers(context, machine).receivers
    return events_page(status, events, receivers, context.now(), kind, before)
