"""A drift test's record: maps of its thermal states, and its course as a verification."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Annotated, Any, Final

import numpy as np
from pydantic import Field

from app.answer import Answer
from app.arrays import FloatArray
from app.effects.observations import Observation, Verification
from app.errors import Conflict, InvalidContent, list_names
from app.geometry.components import COMPONENTS, LINEAR_LETTERS
from app.measurement.result import MeasurementResult
from app.measurement.thermal_drift import DriftState, ThermalDrift
from app.rounding import Digits
from app.search.rows import Datum
from app.services.ask_field import Triple
from app.services.change_model import reading_machine
from app.services.context import Context
from app.services.error_maps import (
    StoredOnce,
    preview_error_map,
    store_error_maps,
    table_remarks,
)
from app.services.measurements import MeasurementRequest, Storing, measurement_fields
from app.services.readings import store_readings
from app.services.verifications import check_verification, store_verification
from app.stated import MachineState, Number, Schema, UtcTime
from app.storage.verifications import find_verification_by_label
from app.thermal.error_map import ComputedTables, ErrorMap
from app.thermal.machine import Machine
from app.thermal.reading import Reading
from app.units import SECONDS_PER_MIN, utc_time

SPINDLE_SPEED: Final = "spindle_rpm"
"""The state that says when the spindle turned, where nobody states it."""


SAME_READINGS: Final = (
    "the maps and the verification are the same readings, so that comparing them shows nothing: "
    "make maps of one test, and verify them by another"
)


class DriftReading(Schema):
    """Time, temperatures [°C] and state beside one reading of the nest."""

    time: UtcTime = Field(description="When, with a zone", examples=["2026-03-01T06:00:00Z"])
    temperatures_c: dict[str, Number] = Field(
        default_factory=dict,
        max_length=1000,
        description="Temperatures by sensor at that time [°C]; leave a failed sensor out",
        examples=[{"x-middle": 24.1, "z-column": 27.3}],
    )
    state: MachineState


@dataclass(frozen=True, slots=True)
class Nest:
    """Where the nest was read; `point_mm` is None where nobody says it."""

    point_mm: Triple | None
    tool_offset_mm: Triple


@dataclass(frozen=True, slots=True, eq=False)
class KeptState(Answer, published_as="DriftStateAnswer"):
    """One thermal state of the test: changes since its first reading, at their temperatures."""

    label: Annotated[str | None, Field(examples=["Warm-up, 60 min"])]
    """The map's name"""
    after_min: Digits
    """Time after the first reading [min]"""
    time: datetime
    """When it was, UTC"""
    temperatures_c: Mapping[str, Digits]
    """The sensors at that time, interpolated between readings [°C]"""
    tables: Annotated[ComputedTables, Field(alias="components")]
    """Changes of the components since the first reading"""
    map_id: int | None = None
    """The number of the map that was made of it"""


@dataclass(frozen=True, slots=True)
class KeptVerification(Answer, published_as="DriftVerificationAnswer"):
    """The course of the test as a verification."""

    id: Annotated[int, Field(examples=[1])]
    """The verification's number"""
    observations: Annotated[int, Field(examples=[240])]
    """How many observations it has"""
    components: Annotated[Sequence[str], Field(examples=[["points"]])]
    """What was observed: component codes, and `points`"""
    is_new: bool
    """False where the same verification was there already"""
    stored_readings: int
    """Readings of temperatures that are new"""


def running_of(
    recorded: Sequence[DriftReading], since: datetime | None, until: datetime | None
) -> tuple[float, float]:
    """Say from when to when the spindle turned or the axis moved [s since 1970-01-01 UTC].

    As stated; else from the last reading before the spindle's first speed above 0 to the last
    with one; else the whole record.
    """
    times = [reading.time.timestamp() for reading in recorded]
    turning = [i for i, reading in enumerate(recorded) if reading.state.get(SPINDLE_SPEED)]
    first = times[max(turning[0] - 1, 0)] if turning else times[0]
    last = times[turning[-1]] if turning else times[-1]
    return (
        first if since is None else since.timestamp(),
        last if until is None else until.timestamp(),
    )


def keep_drift(
    context: Context,
    machine: Machine,
    header: MeasurementRequest,
    drift: ThermalDrift,
    nest: Nest,
    recorded: Sequence[DriftReading],
    storing: Storing,
) -> dict[str, Any]:
    """Store what is asked for, maps of states, a verification or both; give the answer's fields.

    All is checked before anything is stored. With a verification go its temperatures, as the
    machine's readings.

    Raises
    ------
    InvalidContent
        If what is to be stored has no label, no tables, or temperatures are missing; as
        `store_error_map` and `store_verification`.
    Conflict
        If the machine has maps of these components from elsewhere, whose zero is another; as
        the same.
    """
    states = [_keep_state(header.label, state, recorded) for state in drift.states]
    for state in drift.states:
        _expect_axes(machine, state)
    wants_maps = storing.store or storing.preview
    label = _label(header) if wants_maps or storing.course else ""
    maps = [_error_map(header, state, drift.result) for state in states] if wants_maps else []
    refused = _refused_beside(context, machine, states)
    if maps:
        if refused:
            raise Conflict(refused)
        previews = [preview_error_map(context, machine.id, error_map) for error_map in maps]
    verification, stored_verification = None, None
    about: list[str] = []
    if storing.course and not storing.preview:
        verification = _verification(label, drift, nest, recorded, header.repeatability_um)
        stored_verification = _keep_verification(context, machine, verification, recorded)
    elif refused and not maps:
        about = [f"maps of its states would be refused: {refused}"]
    if (maps or verification) and _are_both(context, machine, label, states, storing, verification):
        about = [SAME_READINGS]
    remarks: Sequence[str] = table_remarks(machine, drift.result.tables)
    preview, last = None, None
    if storing.preview:
        preview = previews[-1]
        remarks = preview.warnings
    elif maps:
        stored = store_error_maps(context, machine.id, maps, accept_losses=storing.accept_losses)
        states = [replace(s, map_id=m.stored.id) for s, m in zip(states, stored, strict=True)]
        last = _last_made(stored)
        remarks = last.remarks
    return {
        **measurement_fields(
            machine.id, "thermal-drift", header, drift, [*remarks, *about], last, preview
        ),
        "states": states,
        "verification": stored_verification,
    }


def _last_made(stored: Sequence[StoredOnce]) -> StoredOnce:
    """Give the last map, with the version that was made last."""
    versions = [outcome.made for outcome in stored if outcome.made is not None]
    return replace(stored[-1], made=versions[-1] if versions else None)


def _label(header: MeasurementRequest) -> str:
    if header.label is None:
        raise InvalidContent.of_field("label", "expected label of what is to be stored, got none")
    return header.label


def _keep_state(
    label: str | None, state: DriftState, recorded: Sequence[DriftReading]
) -> KeptState:
    first_s = recorded[0].time.timestamp()
    after_min = (state.time_s - first_s) / SECONDS_PER_MIN
    return KeptState(
        None if label is None else f"{label}, {after_min:g} min",
        after_min,
        utc_time(state.time_s),
        _temperatures_at(state.time_s, recorded),
        state.tables,
    )


def _temperatures_at(time_s: float, recorded: Sequence[DriftReading]) -> dict[str, float]:
    """Interpolate each sensor between its readings; one that began later or ended is left out."""
    temperatures_c: dict[str, float] = {}
    for sensor in dict.fromkeys(name for reading in recorded for name in reading.temperatures_c):
        rows = [
            (reading.time.timestamp(), reading.temperatures_c[sensor])
            for reading in recorded
            if sensor in reading.temperatures_c
        ]
        times, values = zip(*rows, strict=True)
        if times[0] <= time_s <= times[-1]:
            temperatures_c[sensor] = float(np.interp(time_s, times, values))
    return temperatures_c


def _expect_axes(machine: Machine, state: DriftState) -> None:
    for table in state.tables:
        if table.component.axis not in machine.chain.axes:
            raise InvalidContent.of_field(
                "axis",
                f"expected an axis of {machine.chain.text}, got {table.component.axis!r}",
            )


def _error_map(header: MeasurementRequest, state: KeptState, result: MeasurementResult) -> ErrorMap:
    if not state.tables:
        raise InvalidContent.of_field(
            "point_mm", "expected where the nest stood in mm for the maps of its states, got none"
        )
    if not state.temperatures_c:
        raise InvalidContent.of_field(
            "readings",
            "expected temperatures_c beside the displacements for the maps of thermal states, "
            "got none",
        )
    return ErrorMap(
        label=str(state.label),
        measured_at=state.time,
        temperatures_c=dict(state.temperatures_c),
        tables={table.component.code: table for table in state.tables},
        measuring_lines=result.measuring_lines,
        repeatability_um=header.repeatability_um,
        instrument=header.instrument or "thermal-drift",
    )


def _refused_beside(context: Context, machine: Machine, states: Sequence[KeptState]) -> str:
    """Say why maps of the states are refused: others have another zero; empty where none has.

    A state's map holds changes since the test began. Beside a map of whole errors, or of another
    test, the difference of the two zeros would be taken for what the temperature does.
    """
    labels = {state.label for state in states}
    codes = {table.component.code for table in states[-1].tables}
    other = next(
        (
            error_map
            for error_map in _latest_maps(context, machine)
            if error_map.label not in labels and codes & set(error_map.tables)
        ),
        None,
    )
    if other is None:
        return ""
    shared = [code for code in COMPONENTS if code in codes & set(other.tables)]
    return (
        f"machine {machine.id!r} has the error map {other.label!r} of {list_names(shared)} "
        "with another zero than this test, whose tables are changes since its first reading: "
        "between them the model would take the difference of the zeros for an effect of "
        "temperature. Store the test as a verification, or delete those maps first"
    )


def _latest_maps(context: Context, machine: Machine) -> list[ErrorMap]:
    with reading_machine(context, machine.id) as change:
        latest = change.latest
        return [stored.error_map for stored in (latest.maps if latest else [])]


def _are_both(
    context: Context,
    machine: Machine,
    label: str,
    states: Sequence[KeptState],
    storing: Storing,
    verification: Verification | None,
) -> bool:
    """Whether the machine then has maps of the test and its verification, now or from before."""
    if storing.preview:
        return False
    labels = {state.label for state in states}
    has_maps = storing.store or any(m.label in labels for m in _latest_maps(context, machine))
    if verification is not None or not has_maps:
        return has_maps
    with context.database.reading() as session:
        return find_verification_by_label(session, machine.id, label) is not None


def _verification(
    label: str,
    drift: ThermalDrift,
    nest: Nest,
    recorded: Sequence[DriftReading],
    repeatability_um: float | None,
) -> Verification:
    """Write the course as observations of one set-up, zeroed at its first."""
    if all(not reading.temperatures_c for reading in recorded):
        raise InvalidContent.of_field(
            "readings",
            "expected temperatures_c beside the displacements for the verification, got none",
        )
    times = np.array([reading.time.timestamp() for reading in recorded])
    if drift.targets_mm.size:
        observations = _of_targets(label, drift, recorded, times)
    elif nest.point_mm is None:
        raise InvalidContent.of_field(
            "point_mm", "expected where the nest stood in mm for the verification, got none"
        )
    else:
        observations = _at_the_nest(label, drift, nest, nest.point_mm, recorded, times)
    return Verification(label, tuple(observations), Datum.FIRST, repeatability_um)


def _of_targets(
    label: str, drift: ThermalDrift, recorded: Sequence[DriftReading], times: FloatArray
) -> list[Observation]:
    """Observe the moving axis' components where it stood.

    Each target counts from its own first reading, so each is a set-up of its own: between
    targets nothing was measured but the change.
    """
    rows = {time_s: i for i, time_s in enumerate(times.tolist())}
    observations = []
    for name, code in drift.components.items():
        for target, course in zip(drift.targets_mm.tolist(), drift.courses[name], strict=True):
            for time_s, value in zip(course.times_s.tolist(), course.values.tolist(), strict=True):
                observations.append(
                    Observation(
                        time_s=time_s,
                        measured=(value,),
                        component=code,
                        position_mm=target,
                        state=dict(recorded[rows[time_s]].state),
                        setup=f"{label}, {target:g} mm",
                    )
                )
    return sorted(observations, key=lambda observation: observation.time_s)


def _at_the_nest(
    label: str,
    drift: ThermalDrift,
    nest: Nest,
    point_mm: Triple,
    recorded: Sequence[DriftReading],
    times: FloatArray,
) -> list[Observation]:
    """Observe the error at the nest's point, or the components as which displacements count.

    The point where all three displacements were read and none is said to be a component's:
    whatever part of the machine moved, the point saw it. A tilt at the nest is the sum of all
    rotations there; it is observed as a component only where it is said to be one.
    """
    values = {name: of[0].values for name, of in drift.courses.items()}
    has_point = all(name in values for name in LINEAR_LETTERS) and not drift.stated_components
    observations = []
    for i, reading in enumerate(recorded):
        state = dict(reading.state)
        if has_point:
            x, y, z = (float(values[name][i]) for name in LINEAR_LETTERS)
            observations.append(
                Observation(
                    time_s=float(times[i]),
                    measured=(x, y, z),
                    point_mm=point_mm,
                    tool_offset_mm=nest.tool_offset_mm,
                    state=state,
                    setup=label,
                )
            )
            continue
        for name, code in drift.components.items():
            if name not in LINEAR_LETTERS and name not in drift.stated_components:
                continue
            axis = str(COMPONENTS[code].axis)
            observations.append(
                Observation(
                    time_s=float(times[i]),
                    measured=(float(values[name][i]),),
                    component=code,
                    position_mm=point_mm[LINEAR_LETTERS.index(axis)],
                    state=state,
                    setup=label,
                )
            )
    return observations


def _keep_verification(
    context: Context,
    machine: Machine,
    verification: Verification,
    recorded: Sequence[DriftReading],
) -> KeptVerification:
    """Store the temperatures as readings, then the verification that is compared at them."""
    check_verification(context, machine.id, verification)
    readings = [
        Reading(reading.time, dict(reading.temperatures_c), dict(reading.state))
        for reading in recorded
        if reading.temperatures_c
    ]
    outcome = store_readings(context, machine.id, readings)
    stored = store_verification(context, machine.id, verification)
    kept = stored.stored
    return KeptVerification(kept.id, kept.count, kept.components, stored.is_new, outcome.stored)
