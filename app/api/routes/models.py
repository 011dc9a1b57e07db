"""Sensor assignment and model versions."""

from __future__ import annotations

from fastapi import Response

from app.access.keys import Role
from app.api.access import needs
from app.api.bodies import BodyRoute
from app.api.dependencies import (
    AcceptLossesQuery,
    ContextDep,
    MachinePath,
    PreviewQuery,
    VersionPath,
)
from app.api.router import Router
from app.services.models import (
    Assignment,
    ChangedModelAnswer,
    Correlated,
    ModelAnswer,
    ModelCoverage,
    Preview,
    WaitingAssignmentAnswer,
    activate_model,
    assign_sensors,
    correlate_sensors,
    preview_activation,
    preview_assignment,
    sensor_assignment,
    show_coverage,
    show_model,
    show_models,
)

router = Router(route_class=BodyRoute, prefix="/v1/machines/{machine}", tags=["models"])


@router.get("/sensor-assignment", summary="Show which sensor each component follows")
def get_assignment(context: ContextDep, machine: MachinePath) -> dict[str, str]:
    """Show the active version's assignment: component to sensor."""
    return sensor_assignment(context, machine)


@router.put(
    "/sensor-assignment",
    summary="Assign sensors to components",
    responses={202: {"model": WaitingAssignmentAnswer, "description": "Stored, not activated"}},
)
def put_assignment(
    context: ContextDep,
    machine: MachinePath,
    body: Assignment,
    response: Response,
    preview: PreviewQuery = False,
    accept_losses: AcceptLossesQuery = False,
) -> dict[str, str] | WaitingAssignmentAnswer | Preview:
    """Assign sensors; components that are not named keep theirs. Makes the next version.

    A version whose tables would lose something against the active one is stored and waits: the
    answer is 202 then, and says what is lost and how to activate it all the same.
    """
    if preview:
        return preview_assignment(context, machine, body)
    assigned = assign_sensors(context, machine, body, accept_losses=accept_losses)
    if isinstance(assigned, WaitingAssignmentAnswer):
        response.status_code = 202
        return assigned
    return dict(assigned)


@router.post("/sensor-assignment/correlate", summary="Propose sensors by correlation")
@needs(Role.VIEWER)
def post_correlate(context: ContextDep, machine: MachinePath) -> Correlated:
    """Correlate each component's change over the maps with each sensor; nothing changes."""
    return correlate_sensors(context, machine)


@router.get("/models", summary="List model versions")
def get_models(context: ContextDep, machine: MachinePath) -> list[ModelAnswer]:
    """List all versions, oldest first."""
    return show_models(context, machine)


@router.get("/models/{version}", summary="Show a model version")
def get_model(context: ContextDep, machine: MachinePath, version: VersionPath) -> ModelAnswer:
    """Show one version with its maps and assignment."""
    return show_model(context, machine, version)


@router.get("/models/{version}/coverage", summary="Show what a model version covers")
def get_coverage(context: ContextDep, machine: MachinePath, version: VersionPath) -> ModelCoverage:
    """Show which components the tables of a version have, and why they lack others."""
    return show_coverage(context, machine, version)


@router.post("/models/{version}/activate", summary="Activate a model version")
def post_activate(
    context: ContextDep, machine: MachinePath, version: VersionPath, preview: PreviewQuery = False
) -> ChangedModelAnswer | Preview:
    """Compute tables with this version from now on, whatever they lose: the answer says what.

    A version that waits for its activation is given up by activating another one, also the one
    that is active: the next version is made of that.
    """
    if preview:
        return preview_activation(context, machine, version)
    return activate_model(context, machine, version)
