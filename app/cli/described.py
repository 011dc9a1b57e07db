"""Machines and planned visits, made of what the service answers, for what is computed here."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from app.effects.observations import Observation, Verification
from app.geometry.chain import Chain
from app.geometry.components import LINEAR_LETTERS, parse_component
from app.search.rows import Datum
from app.thermal.machine import Machine, Sensor, Travel, sensors_by_name
from thermap.answers import MachineAnswer, PlannedObservation, PlannedVerification

_SIGNS = {"+": 1, "-": -1, None: 0}


def machine_of(answer: MachineAnswer) -> Machine:
    """Make the machine that the service describes."""
    return Machine(
        id=answer.id,
        name=answer.name,
        chain=Chain.parse(answer.configuration),
        axes={axis: Travel(t.min_mm, t.max_mm) for axis, t in answer.axes.items()},
        sensors=sensors_by_name([Sensor(**sensor.model_dump()) for sensor in answer.sensors]),
        serial_number=answer.serial_number,
    )


def described(machine: Machine) -> dict[str, Any]:
    """Describe a machine as the service takes it."""
    return {
        "id": machine.id,
        "name": machine.name,
        "configuration": machine.chain.text,
        "axes": {axis: asdict(travel) for axis, travel in machine.axes.items()},
        "sensors": [asdict(sensor) for sensor in machine.sensors.values()],
        "out_of_range": machine.out_of_range,
        "extrapolation_margin_c": machine.extrapolation_margin_c,
        "extrapolation_error_ratio": machine.extrapolation_error_ratio,
        "same_temperature": machine.same_temperature,
    }


def visit_of(planned: PlannedVerification) -> Verification:
    """Make the visit that the service has read."""
    return Verification(
        planned.label,
        tuple(map(_observation_of, planned.observations)),
        Datum(planned.datum),
        planned.repeatability_um,
        is_planned=True,
    )


def _observation_of(planned: PlannedObservation) -> Observation:
    code = None if planned.component is None else parse_component(planned.component)[0].code
    direction = planned.direction
    signs = dict.fromkeys(LINEAR_LETTERS, direction) if isinstance(direction, str) else direction
    ways: dict[Any, Any] = {**(signs or {})}
    x, y, z = (_SIGNS[ways.get(axis)] for axis in LINEAR_LETTERS)
    point, (tx, ty, tz) = planned.point_mm, planned.tool_offset_mm
    return Observation(
        time_s=planned.time.timestamp(),
        measured=(0.0,) if point is None else (0.0, 0.0, 0.0),
        component=code,
        position_mm=planned.position_mm,
        point_mm=None if point is None else (point[0], point[1], point[2]),
        tool_offset_mm=(tx, ty, tz),
        directions=(x, y, z),
        state=planned.state,
        setup=planned.setup,
    )
