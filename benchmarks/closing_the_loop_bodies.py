"""The bodies of a simulated campaign, read as the service's own objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, parse_component
from app.identification.campaign import Campaign
from app.identification.observations import Observation, Verification
from app.identification.search.rows import Datum
from app.thermal.compile_model import compile_model
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.machine import Machine, OutOfRange, Sensor, Travel, sensors_by_name
from app.thermal.temperature_history import TemperatureHistory

Body = Mapping[str, Any]
SIGNS = {"+": 1, "-": -1}


def campaign_of_bodies(
    machine_body: Body,
    map_bodies: Sequence[Body],
    readings: Sequence[Body],
    verification_bodies: Sequence[Body],
) -> Campaign:
    """Read bodies of HTTP requests.

    Parameters
    ----------
    machine_body, map_bodies, readings, verification_bodies
        As `benchmarks.undeclared` writes them.

    Returns
    -------
    Campaign
    """
    machine = _machine(machine_body)
    maps = [_error_map(body) for body in map_bodies]
    times = [_seconds(r["time"]) for r in readings]
    rows = [(t, r["temperatures_c"]) for t, r in zip(times, readings, strict=True)]
    return Campaign(
        model=compile_model(machine, maps, {}),
        maps=maps,
        verifications=[_verification(body) for body in verification_bodies],
        readings=TemperatureHistory.of_readings(machine.sensors, rows),
        state_readings=[(t, r["state"]) for t, r in zip(times, readings, strict=True)],
    )


def _machine(body: Body) -> Machine:
    return Machine(
        id=body["id"],
        name=body["name"],
        chain=Chain.parse(body["configuration"]),
        axes={axis: Travel(t["min_mm"], t["max_mm"]) for axis, t in body["axes"].items()},
        sensors=sensors_by_name([Sensor(**sensor) for sensor in body["sensors"]]),
        out_of_range=OutOfRange(body["out_of_range"]),
        extrapolation_margin_c=body["extrapolation_margin_c"],
    )


def _error_map(body: Body) -> ErrorMap:
    return ErrorMap(
        label=body["label"],
        measured_at=datetime.fromisoformat(body["measured_at"]),
        temperatures_c=body["temperatures_c"],
        tables={part["component"]: _table(part) for part in body["components"]},
        instrument=body["instrument"],
    )


def _table(part: Body) -> ComponentTable:
    component = COMPONENTS[part["component"]]
    unit = component.unit
    if not component.is_table:
        stated = part.get(f"standard_error_{unit}")
        covariance = None if stated is None else [stated**2]
        return ComponentTable.make(component, [part[f"value_{unit}"]], covariance=covariance)
    stated = part.get(f"standard_errors_{unit}")
    return ComponentTable.make(
        component,
        part[f"errors_{unit}"],
        part["positions_mm"],
        covariance=None if stated is None else [s**2 for s in stated],
    )


def _verification(body: Body) -> Verification:
    return Verification(
        label=body["label"],
        observations=[_observation(o) for o in body["observations"]],
        datum=Datum(body["datum"]),
        repeatability_um=body["repeatability_um"],
    )


def _observation(body: Body) -> Observation:
    time_s, state = _seconds(body["time"]), body.get("state", {})
    if "component" not in body:
        directions = body.get("direction", {})
        x, y, z = (SIGNS.get(directions.get(axis, ""), 0) for axis in LINEAR_LETTERS)
        return Observation(
            time_s,
            tuple(body["measured_um"]),
            point_mm=tuple(body["point_mm"]),
            tool_offset_mm=tuple(body["tool_offset_mm"]),
            directions=(x, y, z),
            state=state,
        )
    component, sign = parse_component(body["component"])
    directions = [0, 0, 0]
    if component.axis is not None:
        directions[LINEAR_LETTERS.index(component.axis)] = SIGNS.get(body.get("direction", ""), 0)
    return Observation(
        time_s,
        (sign * body["measured_um"],),
        component.code,
        body.get("position_mm"),
        directions=(directions[0], directions[1], directions[2]),
        state=state,
    )


def _seconds(time: str) -> float:
    return datetime.fromisoformat(time).timestamp()
