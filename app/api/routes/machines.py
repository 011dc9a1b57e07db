"""Machines."""

from __future__ import annotations

from fastapi import Request, Response

from app.access.keys import Role
from app.api.access import needs, sees
from app.api.bodies import BodyRoute
from app.api.dependencies import ContextDep, MachinePath
from app.api.router import Router
from app.services.machines import (
    MachineAnswer,
    MachinePatch,
    change_machine,
    create_machine,
    delete_machine,
    machine_answer,
    show_machine,
    show_machines,
)
from app.thermal.machine import Machine

router = Router(route_class=BodyRoute, prefix="/v1/machines", tags=["machines"])


@router.post(
    "",
    status_code=201,
    summary="Create a machine",
    responses={200: {"model": MachineAnswer, "description": "The machine, which is there already"}},
)
@needs(Role.ADMIN)
def post_machine(context: ContextDep, body: Machine, response: Response) -> MachineAnswer:
    """Create a machine with its axes and sensors; the same again answers 200 with it."""
    stored, is_new = create_machine(context, body)
    response.status_code = 201 if is_new else 200
    response.headers["Location"] = f"/v1/machines/{stored.machine.id}"
    return machine_answer(stored)


@router.get("", summary="List machines")
def get_machines(request: Request, context: ContextDep) -> list[MachineAnswer]:
    """List all machines by id."""
    may_see = sees(request)
    return [machine_answer(m) for m in show_machines(context) if may_see(m.machine.id)]


@router.get("/{machine}", summary="Show a machine")
def get_machine(context: ContextDep, machine: MachinePath) -> MachineAnswer:
    """Show one machine."""
    return machine_answer(show_machine(context, machine))


@router.patch("/{machine}", summary="Change a machine")
@needs(Role.ADMIN)
def patch_machine(context: ContextDep, machine: MachinePath, body: MachinePatch) -> MachineAnswer:
    """Change the stated settings; the live table follows at once."""
    return machine_answer(change_machine(context, machine, body.apply))


@router.delete("/{machine}", status_code=204, summary="Delete a machine")
@needs(Role.ADMIN)
def delete_machine_route(context: ContextDep, machine: MachinePath) -> None:
    """Delete a machine with all its maps, models and readings.

    Keys that were for it only are revoked; others that name it are for it no more.
    """
    delete_machine(context, machine)
