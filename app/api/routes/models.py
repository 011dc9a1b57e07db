"""Sensor assignment and model versions."""

from __future__ import annotations

from fastapi import APIRouter

from app.api.dependencies import ContextDep, MachinePath, VersionPath
from app.api.schemas.models import AssignmentSchema, CorrelationAnswer, ModelAnswer
from app.services.activate_model import activate_model
from app.services.assign_sensors import assign_sensors, correlate_sensors, sensor_assignment
from app.services.show_machines import show_model, show_models

router = APIRouter(prefix="/v1/machines/{machine}", tags=["models"])


@router.get("/sensor-assignment", summary="Show which sensor each component follows")
def get_assignment(context: ContextDep, machine: MachinePath) -> AssignmentSchema:
    """Show the active version's assignment."""
    return AssignmentSchema.of(dict(sensor_assignment(context, machine)))


@router.put("/sensor-assignment", summary="Assign sensors to components")
def put_assignment(
    context: ContextDep, machine: MachinePath, body: AssignmentSchema
) -> AssignmentSchema:
    """Assign sensors; components that are not named keep theirs. Makes the next version."""
    return AssignmentSchema.of(dict(assign_sensors(context, machine, body.to_codes())))


@router.post("/sensor-assignment/correlate", summary="Propose sensors by correlation")
def post_correlate(context: ContextDep, machine: MachinePath) -> CorrelationAnswer:
    """Correlate each component's change over the maps with each sensor; nothing changes."""
    return CorrelationAnswer.of(correlate_sensors(context, machine))


@router.get("/models", summary="List model versions")
def get_models(context: ContextDep, machine: MachinePath) -> list[ModelAnswer]:
    """List all versions, oldest first."""
    versions, active = show_models(context, machine)
    return [ModelAnswer.of(version, active) for version in versions]


@router.get("/models/{version}", summary="Show a model version")
def get_model(context: ContextDep, machine: MachinePath, version: VersionPath) -> ModelAnswer:
    """Show one version with its maps and assignment."""
    return ModelAnswer.of(*show_model(context, machine, version))


@router.post("/models/{version}/activate", summary="Activate a model version")
def post_activate(context: ContextDep, machine: MachinePath, version: VersionPath) -> ModelAnswer:
    """Compute tables with this version from now on."""
    return ModelAnswer.of(activate_model(context, machine, version), version)
