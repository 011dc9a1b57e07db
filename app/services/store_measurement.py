"""Make an error map of what a measurement yields, if that is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from app.errors import FieldError, InvalidContent, list_names
from app.geometry.components import LINEAR_LETTERS
from app.geometry.work_volume import WorkVolume
from app.measurement.result import MeasurementResult
from app.services.context import Context
from app.services.load_machine import load_machine
from app.services.preview_model import Preview
from app.services.store_error_map import (
    StoredOnce,
    preview_error_map,
    remarks,
    store_error_map,
    table_remarks,
)
from app.thermal.error_map import ErrorMap
from app.thermal.machine import Machine, Travel


@dataclass(frozen=True, slots=True)
class MapHeader:
    """What an error map needs beside its components; None where it was not stated."""

    label: str | None
    measured_at: datetime | None
    temperatures_c: Mapping[str, float] | None
    instrument: str | None
    repeatability_um: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A measurement's result, and the map that was made of it, or what storing it would do."""

    machine: Machine
    method: str
    result: MeasurementResult
    stored: StoredOnce | None
    remarks: list[str]
    preview: Preview | None = None


@dataclass(frozen=True, slots=True)
class Storing:
    """What is to become of a result: nothing, a look at what storing would do, or a map.

    A preview stores nothing, whatever else is stated.
    """

    store: bool = False
    preview: bool = False
    accept_losses: bool = False


def measured_machine(context: Context, machine_id: str) -> Machine:
    """Describe the machine that is measured.

    Raises
    ------
    UnknownThing
        If there is no such machine.
    """
    live = context.live.get(machine_id) or load_machine(context, machine_id)
    return live.current.model.machine


def store_measurement(
    context: Context,
    machine: Machine,
    method: str,
    header: MapHeader,
    result: MeasurementResult,
    storing: Storing,
) -> Measured:
    """Hand a result on, and store it as an error map if that is asked for.

    Raises
    ------
    InvalidContent, Conflict
        As `store_error_map`; InvalidContent also where the map's label, time or
        temperatures are not stated, or the machine lacks the measured axis.
    """
    for table in result.tables:
        axis = table.component.axis
        if axis is not None and axis not in machine.chain.axes:
            raise InvalidContent.of_field(
                "axis", f"expected an axis of {machine.chain.text}, came {axis!r}"
            )
    if not (storing.store or storing.preview):
        return Measured(machine, method, result, None, table_remarks(machine, result.tables))
    error_map = _error_map(method, header, result)
    if storing.preview:
        preview = preview_error_map(context, machine.id, error_map)
        return Measured(machine, method, result, None, remarks(machine, error_map), preview)
    stored = store_error_map(context, machine.id, error_map, accept_losses=storing.accept_losses)
    return Measured(stored.machine, method, result, stored, remarks(stored.machine, error_map))


def _error_map(method: str, header: MapHeader, result: MeasurementResult) -> ErrorMap:
    label, measured_at, temperatures_c = header.label, header.measured_at, header.temperatures_c
    if label is None or measured_at is None or not temperatures_c:
        stated = {"label": label, "measured_at": measured_at, "temperatures_c": temperatures_c}
        lacking = [name for name, value in stated.items() if not value]
        message = f"expected {list_names(lacking)} for the map that is to be stored, came none"
        raise InvalidContent(message, [FieldError(name, message) for name in lacking])
    return ErrorMap(
        label=label,
        measured_at=measured_at,
        temperatures_c=temperatures_c,
        tables={table.component.code: table for table in result.tables},
        measuring_lines=result.measuring_lines,
        repeatability_um=header.repeatability_um,
        # A map says at least by which method it was made.
        instrument=header.instrument or method,
    )


def travel_volume(machine: Machine, stated: Mapping[str, Travel]) -> WorkVolume | None:
    """Choose a box: what is stated, else the axes' travel; None where an axis has neither.

    Raises
    ------
    InvalidContent
        If a stated range is of no axis, or no range.
    """
    unknown = [axis for axis in stated if axis not in LINEAR_LETTERS]
    if unknown:
        raise InvalidContent.of_field(
            f"volume.{unknown[0]}", f"expected axes x, y and z, came {list_names(unknown)}"
        )
    travels = [stated.get(axis) or machine.axes.get(axis) for axis in LINEAR_LETTERS]
    if any(travel is None for travel in travels):
        return None
    x, y, z = ((t.min_mm, t.max_mm) for t in travels if t is not None)
    return WorkVolume(x, y, z)
