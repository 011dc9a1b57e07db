"""Measurements that make maps: what an instrument read goes in, components come out."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from fastapi import Depends, Query, Request
from starlette.concurrency import run_in_threadpool

from app.access.keys import Role
from app.api.access import needs
from app.api.bodies import BodyRoute, body_of_at_most, in_a_thread
from app.api.dependencies import (
    AcceptLossesQuery,
    ContextDep,
    MachinePath,
    PreviewQuery,
    machine_in_memory,
)
from app.api.evaluations import (
    body_diagonal_of,
    drilled_plate_of,
    machined_part_of,
    positioning_of,
    rotary_axis_of,
    six_dof_of,
    step_diagonal_of,
)
from app.api.router import Router
from app.api.schemas.error_field import triple
from app.api.schemas.measurements.axes import (
    PositioningAnswer,
    PositioningRequest,
    SixDofRequest,
)
from app.api.schemas.measurements.base import MeasurementAnswer, answer_fields
from app.api.schemas.measurements.diagonals import (
    BodyDiagonalAnswer,
    BodyDiagonalRequest,
    StepDiagonalAnswer,
    StepDiagonalRequest,
)
from app.api.schemas.measurements.drift import (
    DriftStateAnswer,
    ThermalDriftAnswer,
    ThermalDriftRequest,
)
from app.api.schemas.measurements.parts import (
    ComparisonAnswer,
    DrilledPlateAnswer,
    DrilledPlateRequest,
    MachinedPartAnswer,
    MachinedPartRequest,
    PathErrorsAnswer,
    RotaryAxisAnswer,
    RotaryAxisRequest,
)
from app.api.schemas.measurements.simulation import (
    SimulatedStepDiagonal,
    StepDiagonalSimulation,
)
from app.api.turns import Turns
from app.measurement.stated_runs import as_straightness
from app.measurement.thermal_drift import evaluate_thermal_drift
from app.measurement.thermal_drift_readings import DriftTest
from app.services.measurements import (
    Storing,
    measured_machine,
    simulate_step_diagonal,
    store_measurement,
)
from app.services.predictions import predict_part
from app.services.thermal_drift import Nest, keep_drift, running_of

router = Router(
    route_class=BodyRoute, prefix="/v1/machines/{machine}/measurements", tags=["measurements"]
)


def _storing(
    store: Annotated[
        bool, Query(description="Whether the components are stored as an error map")
    ] = False,
    preview: PreviewQuery = False,
    accept_losses: AcceptLossesQuery = False,
) -> Storing:
    return Storing(store, preview, accept_losses)


StoringDep = Annotated[Storing, Depends(_storing)]


@router.post(
    "/step-diagonal",
    summary="Sequential step diagonal (C. Wang)",
    response_model_exclude_unset=True,
)
def post_step_diagonal(
    context: ContextDep, machine: MachinePath, body: StepDiagonalRequest, storing: StoringDep
) -> StepDiagonalAnswer:
    """Derive nine translations and three squareness errors from three or four diagonals."""
    described = measured_machine(context, machine)
    evaluated = step_diagonal_of(described, body)
    measured = store_measurement(
        context, described, "step-diagonal", body.header(), evaluated.result, storing
    )
    closure = evaluated.closure_um
    return StepDiagonalAnswer(
        **answer_fields(measured),
        closure_um=None if closure is None else closure.tolist(),
    )


@router.post(
    "/body-diagonal", summary="Body diagonals (ISO 230-6)", response_model_exclude_unset=True
)
def post_body_diagonal(
    context: ContextDep, machine: MachinePath, body: BodyDiagonalRequest, storing: StoringDep
) -> BodyDiagonalAnswer:
    """Evaluate Ed and ESd, and squareness from the ends."""
    described = measured_machine(context, machine)
    evaluated = body_diagonal_of(described, body)
    measured = store_measurement(
        context, described, "body-diagonal", body.header(), evaluated.result, storing
    )
    return BodyDiagonalAnswer(
        **answer_fields(measured),
        Ed_um=evaluated.accuracy.ed_um,
        ESd_um=evaluated.accuracy.esd_um,
        diagonals_um=dict(evaluated.accuracy.ranges_um),
        reversal_um=dict(evaluated.reversal_um),
    )


@router.post("/positioning", summary="Positioning (ISO 230-2)", response_model_exclude_unset=True)
async def post_positioning(
    request: Request,
    context: ContextDep,
    machine: MachinePath,
    body: PositioningRequest,
    storing: StoringDep,
) -> PositioningAnswer:
    """Evaluate runs over target positions; both directions are kept."""
    described = (await machine_in_memory(request, context, machine)).current.model.machine
    # A million readings take seconds: they are evaluated before it is our turn at the database.
    evaluated = await in_a_thread(lambda: positioning_of(body))

    def stored() -> PositioningAnswer:
        measured = store_measurement(
            context, described, "positioning", body.header(), evaluated.result, storing
        )
        targets = PositioningAnswer.targets_of(evaluated)
        return PositioningAnswer(**answer_fields(measured), targets=targets)

    turns: Turns = request.app.state.turns
    async with turns.taken():
        return await run_in_threadpool(stored)


@router.post(
    "/six-dof", summary="Six errors of one axis (Y.-Y. Hsu)", response_model_exclude_unset=True
)
def post_six_dof(
    context: ContextDep, machine: MachinePath, body: SixDofRequest, storing: StoringDep
) -> MeasurementAnswer:
    """Take displacement, straightness and angles of one axis with their measuring line."""
    described = measured_machine(context, machine)
    result = six_dof_of(body)
    measured = store_measurement(context, described, "six-dof", body.header(), result, storing)
    return MeasurementAnswer(**answer_fields(measured))


@router.post(
    "/machined-part", summary="Straightness of a machined edge", response_model_exclude_unset=True
)
def post_machined_part(
    context: ContextDep, machine: MachinePath, body: MachinedPartRequest, storing: StoringDep
) -> MachinedPartAnswer:
    """Take the straightness of an edge, and compare it with the active model's prediction."""
    described = measured_machine(context, machine)
    predicted = None
    if body.temperatures_c:
        path = body.measuring_line_mm
        predicted = predict_part(
            context,
            machine,
            as_straightness(body.component),
            np.array(body.positions_mm, dtype=np.float64),
            body.temperatures_c,
            None if path is None else triple(path),
            triple(body.tool_offset_mm),
        )
    evaluated = machined_part_of(body, None if predicted is None else predicted.predicted_um)
    measured = store_measurement(
        context, described, "machined-part", body.header(), evaluated.result, storing
    )
    fields = answer_fields(measured)
    comparison = None
    if predicted is not None and evaluated.comparison is not None:
        fields["notes"] += predicted.notes
        comparison = ComparisonAnswer.of(
            evaluated.comparison, predicted.predicted_um.tolist(), predicted.model_version
        )
    return MachinedPartAnswer(
        **fields,
        straightness_um=evaluated.straightness_um,
        slope_um_per_m=evaluated.slope_um_per_m,
        suspicious=list(evaluated.suspicious_measured),
        comparison=comparison,
    )


@router.post(
    "/drilled-plate", summary="Holes of a drilled plate", response_model_exclude_unset=True
)
def post_drilled_plate(
    context: ContextDep, machine: MachinePath, body: DrilledPlateRequest, storing: StoringDep
) -> DrilledPlateAnswer:
    """Take scale, squareness and axis errors from holes, up to a rigid motion."""
    described = measured_machine(context, machine)
    evaluated = drilled_plate_of(body)
    measured = store_measurement(
        context, described, "drilled-plate", body.header(), evaluated.result, storing
    )
    errors = evaluated.scale_standard_errors_um_per_m.tolist()
    return DrilledPlateAnswer(
        **answer_fields(measured),
        rotation_urad=evaluated.rotation_urad,
        shift_mm=evaluated.shift_mm.tolist(),
        scale_um_per_m=evaluated.scale_um_per_m.tolist(),
        scale_standard_errors_um_per_m=[None if math.isnan(e) else e for e in errors],
        squareness_um_per_m=evaluated.squareness_um_per_m,
        residuals_um=evaluated.residuals_um.tolist(),
        suspicious=list(evaluated.suspicious),
    )


@router.post("/rotary-axis", summary="R-test of a rotary axis", response_model_exclude_unset=True)
def post_rotary_axis(
    context: ContextDep, machine: MachinePath, body: RotaryAxisRequest, storing: StoringDep
) -> RotaryAxisAnswer:
    """Find how a rotary axis lies from the places of a ball that it carries."""
    described = measured_machine(context, machine)
    evaluated = rotary_axis_of(body)
    measured = store_measurement(
        context, described, "rotary-axis", body.header(), evaluated.result, storing
    )
    return RotaryAxisAnswer(
        **answer_fields(measured),
        residuals_um=evaluated.residuals_um.tolist(),
        noise_um=evaluated.noise_um,
        degrees_of_freedom=evaluated.degrees_of_freedom,
        path=PathErrorsAnswer(
            before_um=evaluated.path.before_um.tolist(),
            after_position_um=evaluated.path.position_um.tolist(),
            after_all_um=evaluated.path.all_um.tolist(),
        ),
    )


@router.post(
    "/thermal-drift",
    summary="Thermal drift by a nest of displacement sensors (ISO 230-3)",
    response_model_exclude_unset=True,
    openapi_extra=body_of_at_most(8),
)
def post_thermal_drift(
    context: ContextDep,
    machine: MachinePath,
    body: ThermalDriftRequest,
    storing: StoringDep,
    store_verification: Annotated[
        bool,
        Query(
            description="Whether the course is stored as a verification of one set-up, zeroed at "
            "its first observation, with its temperatures as readings of the machine"
        ),
    ] = False,
) -> ThermalDriftAnswer:
    """Evaluate hours of displacements: figures, maps of thermal states, a verification.

    `store` makes a map of each state, all of them or none; `store_verification` the
    verification. Temperatures that are stored with it stay although its values are refused then
    for an evidently wrong unit.
    """
    described = measured_machine(context, machine)
    recorded = body.recorded()
    running = None
    if body.test is not DriftTest.ENVIRONMENT or body.running_from or body.running_to:
        running = running_of(recorded, body.running_from, body.running_to)
    drift = evaluate_thermal_drift(
        described.chain,
        body.test,
        [reading.time.timestamp() for reading in recorded],
        body.displacements_um(),
        axis=body.axis,
        positions_mm=body.positions_mm(),
        sensor_distance_mm=body.sensor_distance_mm,
        running_s=running,
        point_mm=body.point_mm,
        tool_offset_mm=body.tool_offset_mm,
        components=body.components,
        states_s=body.states_s(),
        repeatability_um=body.repeatability_um,
    )
    stored_drift = keep_drift(
        context,
        described,
        body.header(),
        drift,
        Nest(None if body.point_mm is None else triple(body.point_mm), triple(body.tool_offset_mm)),
        recorded,
        storing,
        as_verification=store_verification,
    )
    fields = answer_fields(stored_drift.measured)
    if body.measured_at is not None or body.temperatures_c:
        fields["notes"].append(
            "measured_at and temperatures_c of the whole were not used: each reading has its own."
        )
    if stored_drift.verification is not None:
        fields["verification"] = stored_drift.verification
    return ThermalDriftAnswer(
        **fields, states=[DriftStateAnswer.of(state) for state in stored_drift.states]
    )


@router.post("/step-diagonal/simulate", summary="What a laser would read on the step diagonals")
@needs(Role.VIEWER)
def post_simulation(
    context: ContextDep, machine: MachinePath, body: StepDiagonalSimulation
) -> SimulatedStepDiagonal:
    """Walk the stored machine along its diagonals: for training, and to check a set-up."""
    simulated = simulate_step_diagonal(context, machine, body.question(), body.plan())
    return SimulatedStepDiagonal.of(body, simulated)
