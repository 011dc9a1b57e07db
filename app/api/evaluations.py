"""Measurements evaluated from the bodies in which they are asked, whichever way they came.

One function a method; a drift test makes several maps, and has a way of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

from pydantic import ValidationError

from app.api.schemas.measurements.axes import PositioningRequest, SixDofRequest
from app.api.schemas.measurements.base import MeasurementRequest
from app.api.schemas.measurements.diagonals import BodyDiagonalRequest, StepDiagonalRequest
from app.api.schemas.measurements.parts import (
    DrilledPlateRequest,
    MachinedPartRequest,
    RotaryAxisRequest,
)
from app.arrays import FloatArray
from app.errors import InvalidContent
from app.field_errors import field_error
from app.measurement.body_diagonal import BodyDiagonal, body_diagonal
from app.measurement.drilled_plate import DrilledPlate, evaluate_drilled_plate
from app.measurement.machined_part import MachinedPart, evaluate_machined_part
from app.measurement.positioning import Positioning, evaluate_positioning
from app.measurement.result import MeasurementResult
from app.measurement.rotary_axis import RotaryAxisMeasurement, measure_rotary_axis
from app.measurement.six_dof import evaluate_six_dof
from app.measurement.step_diagonal import StepDiagonal, step_diagonal
from app.services.measurements import travel_volume
from app.thermal.machine import Machine, Travel


def step_diagonal_of(machine: Machine, body: StepDiagonalRequest) -> StepDiagonal:
    """Evaluate sequential step diagonals."""
    return step_diagonal(
        machine.chain,
        body.origin_mm,
        body.step_mm,
        body.diagonals,
        line=body.line,
        angular=body.known_angular(),
        tool_offset_mm=body.tool_offset_mm,
        target=body.target,
        repeatability_um=body.repeatability_um,
        mirror_angle_urad=body.mirror_angle_urad,
        travel_mm={axis: (t.min_mm, t.max_mm) for axis, t in machine.axes.items()},
    )


def body_diagonal_of(machine: Machine, body: BodyDiagonalRequest) -> BodyDiagonal:
    """Evaluate body diagonals, over the axes' travel where no volume is stated."""
    travels = {axis: Travel(t.min_mm, t.max_mm) for axis, t in body.volume.items()}
    return body_diagonal(
        {name: runs.readings() for name, runs in body.diagonals.items()},
        volume=travel_volume(machine, travels),
        chain=machine.chain,
        repeatability_um=body.repeatability_um,
    )


def positioning_of(body: PositioningRequest) -> Positioning:
    """Evaluate runs over target positions."""
    return evaluate_positioning(
        body.axis,
        body.targets_mm,
        body.forward_um,
        body.backward_um or (),
        repeatability_um=body.repeatability_um,
    )


def six_dof_of(body: SixDofRequest) -> MeasurementResult:
    """Evaluate six errors of one axis."""
    return evaluate_six_dof(
        body.axis,
        body.positions_mm,
        body.linear_um,
        body.straightness_um,
        body.angular_urad,
        backward_linear_um=body.backward_linear_um,
        backward_straightness_um=body.backward_straightness_um,
        backward_angular_urad=body.backward_angular_urad,
        measuring_line_mm=body.measuring_line_mm,
        tool_offset_mm=body.tool_offset_mm,
        straightness_line=body.straightness_line,
        repeatability_um=body.repeatability_um,
        repeatability_urad=body.repeatability_urad,
    )


def machined_part_of(
    body: MachinedPartRequest, predicted_um: FloatArray | None = None
) -> MachinedPart:
    """Evaluate an edge, beside what a model predicts of it where that is known."""
    return evaluate_machined_part(
        body.component,
        body.positions_mm,
        body.measured_um,
        predicted_um,
        line=body.line,
        measuring_line_mm=body.measuring_line_mm,
        tool_offset_mm=body.tool_offset_mm,
        repeatability_um=body.repeatability_um,
    )


def drilled_plate_of(body: DrilledPlateRequest) -> DrilledPlate:
    """Evaluate the holes of a plate."""
    try:
        return evaluate_drilled_plate(
            [hole.nominal_mm for hole in body.holes],
            [hole.measured_mm for hole in body.holes],
            origin_mm=body.origin_mm,
            tool_offset_mm=body.tool_offset_mm,
            expansion_um_per_m_k=body.expansion_um_per_m_k,
            drilled_minus_measured_c=body.drilled_minus_measured_c,
            repeatability_um=body.repeatability_um,
        )
    except InvalidContent as error:
        raise _of_holes(error) from None


def rotary_axis_of(body: RotaryAxisRequest) -> RotaryAxisMeasurement:
    """Find how a rotary axis lies."""
    return measure_rotary_axis(
        body.axis,
        [ball.angle_deg for ball in body.points],
        [ball.position_mm for ball in body.points],
        repeatability_um=body.repeatability_um,
        pivot_mm=body.pivot_mm,
    )


def _of_holes(error: InvalidContent) -> InvalidContent:
    """Name the holes' fields as the body has them."""
    columns = {"nominal_mm", "measured_mm"}
    return error.inside("holes") if {e.field for e in error.errors} <= columns else error


Request = TypeVar("Request", bound=MeasurementRequest)


@dataclass(frozen=True, slots=True)
class Evaluation(Generic[Request]):
    """How a method's body is checked, and what makes components of it."""

    request: type[Request]
    evaluate: Callable[[Machine, Request], MeasurementResult]

    def checked(self, fields: Mapping[str, Any]) -> Request:
        """Check a body that was read from a file, as one that came as JSON is.

        Raises
        ------
        InvalidContent
            With the body's fields that cannot be right.
        """
        try:
            return self.request.model_validate(fields)
        except ValidationError as error:
            problems = [field_error(raw) for raw in error.errors()]
            sentence = "; ".join(f"{problem.field}: {problem.message}" for problem in problems)
            raise InvalidContent(sentence, problems) from None


EVALUATIONS: Final[Mapping[str, Evaluation[Any]]] = {
    "positioning": Evaluation(PositioningRequest, lambda _, body: positioning_of(body).result),
    "six-dof": Evaluation(SixDofRequest, lambda _, body: six_dof_of(body)),
    "step-diagonal": Evaluation(StepDiagonalRequest, lambda m, b: step_diagonal_of(m, b).result),
    "body-diagonal": Evaluation(BodyDiagonalRequest, lambda m, b: body_diagonal_of(m, b).result),
    "machined-part": Evaluation(MachinedPartRequest, lambda _, body: machined_part_of(body).result),
    "rotary-axis": Evaluation(RotaryAxisRequest, lambda _, body: rotary_axis_of(body).result),
    "drilled-plate": Evaluation(DrilledPlateRequest, lambda _, body: drilled_plate_of(body).result),
}
"""The methods whose files make one map each."""
