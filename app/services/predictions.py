"""What a model says: at given times, and along an edge that the machine cut."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import timedelta
from typing import Annotated

import numpy as np
from pydantic import Field

from app.answer import Answer
from app.arrays import FloatArray
from app.effects.adopted.held import Missing
from app.effects.adopted.prediction import AskedPlaces, predict_with_effects
from app.effects.conditions import Conditions, StatedStates, recorded_conditions
from app.effects.effect import Effect, acting_on
from app.effects.past import needed_past
from app.effects.projection import missing_at_points
from app.errors import InvalidContent, NotEnoughMaps, counted, list_names
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, Component
from app.rounding import Micro
from app.services.ask_field import TableQuestion, Triple, ask_field, missing_refused
from app.services.change_model import choose_version
from app.services.context import Context
from app.services.load_machine import adopted_effects, compile_version
from app.services.observations import ErrorQuestion
from app.storage.readings import list_readings
from app.storage.records import ModelVersion
from app.thermal.compiled_model import CompiledModel
from app.thermal.group import from_to_mm
from app.thermal.machine import Machine
from app.thermal.prediction import BeyondTables
from app.thermal.reading import Reading
from app.thermal.sensor_health import believed, record_needed_s
from app.thermal.temperature_history import TemperatureHistory


@dataclass(frozen=True, slots=True)
class Predictions(Answer, published_as="PredictionAnswer"):
    """What the model says."""

    model_version: int
    """Version that was asked"""
    predicted_um: list[Micro | list[Micro] | None]
    """For each observation its error [µm; angular errors µrad, squareness µm/m], three numbers x,
    y, z for a point, null where its status says why there is none"""
    status: list[str]
    """For each observation `interpolated`, `at-map`, `clamped`, `extrapolated`, `stand-in`, or
    `no-reading`, `outside-maps`; `effects-only` where no two maps have the component; `held` where
    an adopted effect lies outside where it was learnt and is held at the edge of that;
    `effect-missing` where one lacks what drives it and is not in the value (the warnings say which
    and why)"""
    counted_as_zero: Annotated[list[str], Field(examples=[["ECZ"]])] = field(default_factory=list)
    """Components that points need, that no two maps have and that count as zero"""
    warnings: list[str] = field(default_factory=list)
    """What is not as it should be, in sentences"""


def predict_errors(
    context: Context,
    machine_id: str,
    observations: Sequence[ErrorQuestion],
    version_number: int | None = None,
    *,
    missing_as_zero: bool = False,
    readings: Sequence[Reading] | None = None,
) -> Predictions:
    """Predict the error of each observation.

    Parameters
    ----------
    version_number
        The model version; None for the active one.
    missing_as_zero
        Whether components that a point needs and no two maps have may count as zero.
    readings
        What to go by, in order of time; None for the stored ones.

    Raises
    ------
    InvalidContent
        If a component is not in the model, a position outside the axis' travel, or a point
        needs a component that no two maps have.
    """
    machine, version, readings = _read(context, machine_id, observations, version_number, readings)
    model, effects = compile_version(machine, version), adopted_effects(version)
    _check_positions(machine, observations)
    conditions = _conditions(machine, readings, observations)
    answer = Predictions(version.version, [None] * len(observations), [""] * len(observations))
    for code in dict.fromkeys(o.component for o in observations):
        chosen = np.array([i for i, o in enumerate(observations) if o.component == code])
        questions = [observations[i] for i in chosen]
        places = _places(code, questions)
        predicted = predict_with_effects(model, effects, places, conditions.take(chosen))
        answer.warnings.extend(_left_out(effects, predicted.missing, code))
        answer.warnings.extend(remark.sentence for remark in predicted.held)
        if code is None:
            tools = [o.tool_offset_mm for o in questions]
            missing = missing_at_points(model, effects, tools)
            if missing and not missing_as_zero:
                raise missing_refused(model, missing)
            answer.counted_as_zero.extend(missing)
            answer.warnings.extend([*_said_to_be_zero(model, effects, missing), *model.notes])
        answer.warnings.extend(map(_beyond_tables, predicted.beyond))
        for i, value, status in zip(chosen, predicted.values, predicted.status, strict=True):
            signed = observations[i].sign * value
            answer.predicted_um[i] = None if np.isnan(value).any() else signed.tolist()
            answer.status[i] = str(status)
    return answer


def _places(code: str | None, questions: Sequence[ErrorQuestion]) -> AskedPlaces:
    """Set observations of one component, or at points, side by side."""
    points_mm = np.zeros((len(questions), 3))
    if code is None:
        points_mm[:] = [o.point_mm for o in questions]
    else:
        along = LINEAR_LETTERS.find(COMPONENTS[code].axis or "x")
        points_mm[:, along] = [o.position_mm or 0.0 for o in questions]
    tool_offsets_mm = np.array([o.tool_offset_mm for o in questions], dtype=float)
    directions = np.array([o.directions for o in questions], dtype=float)
    return AskedPlaces(code, points_mm, tool_offsets_mm, directions)


def _conditions(
    machine: Machine, readings: Sequence[Reading], observations: Sequence[ErrorQuestion]
) -> Conditions:
    """Say what held at each observation, and before; what it states of itself goes first."""
    history = TemperatureHistory.of_readings(
        machine.sensors, [(r.time.timestamp(), r.temperatures_c) for r in readings]
    )
    return recorded_conditions(
        machine.sensors,
        believed(machine, history),
        [(r.time.timestamp(), r.state) for r in readings],
        np.array([o.time.timestamp() for o in observations]),
        StatedStates([o.state for o in observations]),
    )


def _read(
    context: Context,
    machine_id: str,
    observations: Sequence[ErrorQuestion],
    version_number: int | None,
    instead: Sequence[Reading] | None,
) -> tuple[Machine, ModelVersion, Sequence[Reading]]:
    """Read the machine, the version, and the readings around the observations.

    They go back as far as the version's effects need the past.
    """
    with context.database.reading() as session:
        machine, version = choose_version(session, machine_id, version_number)
        if instead is not None:
            return machine, version, instead
        around = timedelta(seconds=record_needed_s(machine.sensors.values()))
        before = timedelta(seconds=needed_past(adopted_effects(version)).record_s)
        readings = list_readings(
            session,
            machine_id,
            min(o.time for o in observations) - around - before,
            min(max(o.time for o in observations) + around, context.usable_until()),
        )
        return machine, version, list(readings)


def _check_positions(machine: Machine, observations: Sequence[ErrorQuestion]) -> None:
    for i, o in enumerate(observations):
        if o.point_mm is not None:
            coordinates = dict(zip("xyz", o.point_mm, strict=True))
        elif o.component is not None and COMPONENTS[o.component].axis and o.position_mm is not None:
            coordinates = {str(COMPONENTS[o.component].axis): o.position_mm}
        else:
            continue
        for axis, position in coordinates.items():
            travel = machine.axes.get(axis)
            if travel and not travel.holds(position):
                raise InvalidContent.of_field(
                    f"observations.{i}",
                    f"expected {axis} within the axis' travel of {travel.min_mm:g} to "
                    f"{travel.max_mm:g} mm, got {position:g} mm",
                )


def _beyond_tables(beyond: BeyondTables) -> str:
    """Say that positions lie outside a component's tables, where the end values hold."""
    ranges = list_names([from_to_mm(*range_mm) for range_mm in beyond.ranges_mm], 3)
    tables = "its table" if len(beyond.ranges_mm) == 1 else "its tables"
    return (
        f"{counted(beyond.count, 'position')} of {beyond.code} outside {tables} of {ranges}: "
        "its end values hold there"
    )


def _left_out(effects: Sequence[Effect], missing: Sequence[Missing], code: str | None) -> list[str]:
    """Say which effects are not in all predictions, and why."""
    where = "at points" if code is None else f"of {code}"
    return [
        f"{m.kind} of {list_names(effects[m.effect].components)} is not in some predictions "
        f"{where}: {m.reason}"
        for m in missing
    ]


def _said_to_be_zero(
    model: CompiledModel, effects: Sequence[Effect], missing: Sequence[str]
) -> list[str]:
    """Name the errors that count as zero at points: those that no map or one map only has."""
    unmeasured = [code for code in missing if code not in model.omitted]
    acting = acting_on(effects)
    zeros = [
        f"counted as zero at points: {code}, {why}"
        for code, why in model.omitted.items()
        if code not in acting
    ]
    if unmeasured:
        zeros.append(f"counted as zero at points, no map has them: {', '.join(unmeasured)}")
    return zeros


@dataclass(frozen=True, slots=True, eq=False)
class PartPrediction:
    """Predicted errors along the edge [µm], shape (n,), and what is to be said of them."""

    predicted_um: FloatArray
    model_version: int
    notes: list[str]


def predict_part(
    context: Context,
    machine_id: str,
    component: Component,
    positions_mm: FloatArray,
    temperatures_c: Mapping[str, float],
    path_mm: Triple | None,
    tool_offset_mm: Triple,
) -> PartPrediction | None:
    """Predict the straightness that a part should show.

    Parameters
    ----------
    positions_mm : ndarray, shape (n,) [mm]
        Along its axis.
    temperatures_c
        Sensor to temperature while it was cut [°C].
    path_mm
        A point of the machine's path along the edge: then the prediction is the
        volumetric error there, with rotations and lever arms. Without it, it is the
        component's table alone.
    tool_offset_mm
        Tool offset with which it was cut [mm].

    Returns
    -------
    PartPrediction or None
        None where no model has the component.

    Raises
    ------
    InvalidContent
        As `ask_field`.
    """
    question = TableQuestion(temperatures_c=dict(temperatures_c), tool_offset_mm=tool_offset_mm)
    try:
        field_answer = ask_field(context, machine_id, question, orientation=False)
    except NotEnoughMaps:
        return None
    if component.code not in field_answer.field.tables:
        return None
    if path_mm is None:
        positions, values = field_answer.field.tables[component.code]
        predicted = np.interp(positions_mm, positions, values[0])
        return PartPrediction(predicted, field_answer.model_version, list(field_answer.warnings))
    points = np.tile(path_mm, (positions_mm.size, 1))
    points[:, LINEAR_LETTERS.index(str(component.axis))] = positions_mm
    errors_um, _ = field_answer.field.at(points, tool_offset_mm)
    notes = list(field_answer.warnings)
    if field_answer.counted_as_zero:
        notes.append(f"the prediction counts as zero: {', '.join(field_answer.counted_as_zero)}")
    return PartPrediction(errors_um[:, component.row], field_answer.model_version, notes)
