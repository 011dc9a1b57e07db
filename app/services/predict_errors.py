"""What a model version says at given times, with the stored readings' history."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np

from app.arrays import FloatArray
from app.errors import Conflict, InvalidContent, list_names
from app.geometry.components import COMPONENTS, Kind
from app.services.context import Context
from app.services.load_machine import compile_version
from app.storage.machines import find_machine, stored_machine
from app.storage.model_versions import active_version, find_version
from app.storage.readings import list_readings
from app.storage.records import ModelVersion
from app.thermal.compiled_model import CompiledModel
from app.thermal.machine import Machine
from app.thermal.prediction import predict_component, predict_points
from app.thermal.sensor_health import believed, record_needed_s
from app.thermal.temperature_history import TemperatureHistory


@dataclass(frozen=True, slots=True)
class Observation:
    """Where and when an error is asked for: one component, or a point of the work volume.

    `direction` is +1 or −1 for the direction of approach, 0 where it is not stated;
    `sign` is −1 where the error is asked for under ISO's name and sign (C0Y = −SXY).
    """

    time: datetime
    component: str | None = None
    position_mm: float | None = None
    point_mm: tuple[float, float, float] | None = None
    tool_offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    direction: int = 0
    sign: int = 1


@dataclass(frozen=True, slots=True)
class Predictions:
    """A number or three for each observation, None where its status says why not."""

    model_version: int
    values: list[float | list[float] | None]
    status: list[str]
    warnings: list[str]


def predict_errors(
    context: Context,
    machine_id: str,
    observations: Sequence[Observation],
    version_number: int | None = None,
) -> Predictions:
    """Predict the error of each observation.

    Raises
    ------
    UnknownThing
        If there is no such machine or version.
    InvalidContent
        If a component is not in the model, or a position outside the axis' travel.
    """
    machine, version, history = _read(context, machine_id, observations, version_number)
    model = compile_version(machine, version)
    _check_positions(machine, observations)
    times = np.array([o.time.timestamp() for o in observations])
    temperatures = {
        name: history.at(name, times, sensor.max_age_s) for name, sensor in machine.sensors.items()
    }
    answer = Predictions(version.version, [None] * len(observations), [""] * len(observations), [])
    for code in dict.fromkeys(o.component for o in observations):
        chosen = np.array([i for i, o in enumerate(observations) if o.component == code])
        here = {name: values[chosen] for name, values in temperatures.items()}
        asked = [observations[i] for i in chosen]
        directions = np.array([float(o.direction) for o in asked])
        if code is None:
            predicted = predict_points(
                model,
                here,
                np.array([o.point_mm for o in asked], dtype=float),
                np.array([o.tool_offset_mm for o in asked], dtype=float),
                directions,
                _measuring_lines(version),
            )
            answer.warnings.extend(_absent(model))
            answer.warnings.extend(_points_beyond_tables(model, asked))
        else:
            positions = np.array([o.position_mm or 0.0 for o in asked])
            predicted = predict_component(model, code, here, positions, directions)
            answer.warnings.extend(_beyond_table(model, code, positions))
        for i, value, status in zip(chosen, predicted.values, predicted.status, strict=True):
            signed = observations[i].sign * value
            answer.values[i] = None if np.isnan(value).any() else signed.tolist()
            answer.status[i] = str(status)
    return answer


def _read(
    context: Context,
    machine_id: str,
    observations: Sequence[Observation],
    version_number: int | None,
) -> tuple[Machine, ModelVersion, TemperatureHistory]:
    """Read the machine, the version, and the readings around the observations."""
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        machine = stored_machine(row).machine
        version = (
            active_version(session, row)
            if version_number is None
            else find_version(session, machine_id, version_number)
        )
        if version is None:
            raise Conflict(f"machine {machine_id!r} has no model yet: store error maps first")
        around = timedelta(seconds=record_needed_s(machine.sensors.values()))
        readings = list_readings(
            session,
            machine_id,
            min(o.time for o in observations) - around,
            max(o.time for o in observations) + around,
        )
        history = TemperatureHistory.of_readings(
            machine.sensors, [(r.time.timestamp(), r.temperatures_c) for r in readings]
        )
    return machine, version, believed(machine, history)


def _check_positions(machine: Machine, observations: Sequence[Observation]) -> None:
    for i, o in enumerate(observations):
        if o.point_mm is not None:
            asked = dict(zip("xyz", o.point_mm, strict=True))
        elif o.component is not None and COMPONENTS[o.component].axis and o.position_mm is not None:
            asked = {str(COMPONENTS[o.component].axis): o.position_mm}
        else:
            continue
        for axis, position in asked.items():
            travel = machine.axes.get(axis)
            if travel and not travel.min_mm <= position <= travel.max_mm:
                raise InvalidContent.of_field(
                    f"observations.{i}",
                    f"expected {axis} within the axis' travel of {travel.min_mm:g} to "
                    f"{travel.max_mm:g} mm, came {position:g} mm",
                )


def _beyond_table(model: CompiledModel, code: str, positions_mm: FloatArray) -> list[str]:
    """Say that positions lie outside a component's table, where its end values hold."""
    found = model.find(code)
    if found is None or found[1].positions_mm.size < 2:
        return []
    low, high = found[1].positions_mm[[0, -1]]
    beyond = int(np.count_nonzero((positions_mm < low) | (positions_mm > high)))
    if not beyond:
        return []
    return [
        f"{beyond} positions of {code} lie outside its table of {low:g} to {high:g} mm: "
        "its end values hold there"
    ]


def _points_beyond_tables(model: CompiledModel, asked: Sequence[Observation]) -> list[str]:
    """Say the same of points, for each component that has an argument."""
    points = np.array([o.point_mm for o in asked], dtype=float)
    return [
        words
        for group in model.groups
        for code in group.codes
        if (axis := COMPONENTS[code].axis) is not None
        for words in _beyond_table(model, code, points[:, "xyz".index(axis)])
    ]


def _measuring_lines(version: ModelVersion) -> Mapping[str, tuple[float, float, float]]:
    """Give the measuring lines that all maps share."""
    lines = [dict(m.error_map.measuring_lines_mm) for m in version.maps]
    if any(line != lines[0] for line in lines):
        raise Conflict(
            f"maps {list_names(m.error_map.label for m in version.maps)} were measured along "
            "different lines: errors at points need one line per axis"
        )
    return lines[0] if lines else {}


def _absent(model: CompiledModel) -> list[str]:
    """Name the errors that count as zero at points: those that no map or one map only has."""
    have = {code for group in model.groups for code in group.codes}
    unmeasured = [
        code
        for code, c in COMPONENTS.items()
        if c.kind not in (Kind.SLOPE, Kind.ROTARY_LOCATION)
        and code not in have
        and code not in model.omitted
        and (c.axis is None or c.axis in model.machine.chain.axes)
    ]
    found = [f"counted as zero at points: {code}, {why}" for code, why in model.omitted.items()]
    if unmeasured:
        found.append(f"counted as zero at points, no map has them: {', '.join(unmeasured)}")
    return found
