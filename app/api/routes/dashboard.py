"""The dashboard: pages for people. What they show is what the API answers."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import APIRouter, Query

from app.api.bodies import BodyRoute
from app.api.dependencies import ContextDep, MachinePath
from app.api.pages import Page
from app.pages.dashboard.pages import machine_page, machines_page
from app.services.dashboard import show_machine_view, show_machine_views

router = APIRouter(route_class=BodyRoute, include_in_schema=False)

_HEADERS = {"Cache-Control": "no-store"}

Chosen = Annotated[str, Query(max_length=16)]


@router.get("/", response_class=Page)
def get_machines(
    context: ContextDep,
    only: Literal["", "not-trusted", "limited", "service", "trusted"] = "",
) -> Page:
    """Show all machines: who can be trusted, who cannot and why."""
    views = show_machine_views(context)
    return Page(machines_page(views, context.now(), only), scripts=0, headers=_HEADERS)


@router.get("/machines/{machine}", response_class=Page)
def get_machine(
    context: ContextDep, machine: MachinePath, x: Chosen = "", y: Chosen = "", z: Chosen = ""
) -> Page:
    """Show one machine now; `x`, `y` and `z` name the components that are drawn large."""
    view = show_machine_view(context, machine)
    chosen = {"x": x, "y": y, "z": z}
    return Page(machine_page(view, context.now(), chosen), scripts=0, headers=_HEADERS)
