"""Error maps: store one with the model version that contains it, and take it out of use."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Annotated

import numpy as np
from pydantic import Field

from app.answer import fields_of
from app.arrays import FloatArray
from app.errors import Conflict, FieldError, InvalidContent, list_names
from app.geometry.components import COMPONENTS
from app.measurement.stated_numbers import suspiciously_small
from app.services.change_model import (
    Draft,
    MachineChange,
    MadeVersion,
    ModelChange,
    activate_waiting,
    changing_machine,
    draft_version,
    make_version,
    reading_machine,
    remake_waiting,
)
from app.services.context import FUTURE_TOLERANCE, Context, repeated
from app.services.models import Preview, preview_draft, preview_stored
from app.services.recorded_change import temperatures_then
from app.storage.error_maps import (
    find_error_map,
    find_error_map_by_label,
    insert_error_map,
    same_content,
    withdraw_error_map,
)
from app.storage.records import ModelVersion, StoredMap
from app.storage.tables import ErrorMapRow
from app.thermal.error_map import ComponentTable, ErrorMap, impossible_error, positions_for_errors
from app.thermal.machine import Machine
from app.thermal.mistaken_maps import MIRRORED, REVERSED, copied, inexplicable, mistakes
from app.thermal.sensor_health import Health, check_temperatures
from app.thermal.stated_temperatures import (
    asked_in_fahrenheit,
    doubted_temperatures,
    exchanged_temperatures,
)
from app.units import Unit

SHORT_SHARE_OF_TRAVEL = 0.1
"""A table that covers less than this share of its axis' travel is remarkable."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ErrorMapAnswer(ErrorMap, ModelChange, whole=False):
    """A stored error map."""

    id: Annotated[int, Field(examples=[1])]
    """The map's number"""
    stored_at: datetime
    """When it was stored, UTC"""
    in_active_model: bool
    """Whether the active model version contains it"""
    warnings: Sequence[str] = ()
    """What is unusual about it"""


def map_answer(
    stored: StoredMap,
    in_active_model: bool,
    warnings: Sequence[str] = (),
    change: ModelChange | None = None,
) -> ErrorMapAnswer:
    """Show a stored map, and the version that was made with it."""
    return ErrorMapAnswer(
        **fields_of(stored.error_map),
        **fields_of(change or ModelChange(activated=in_active_model)),
        id=stored.id,
        stored_at=stored.stored_at,
        in_active_model=in_active_model,
        warnings=warnings,
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MapPreview(Preview, whole=False):
    """What was read as a map, and what storing it would do to the tables; nothing is stored."""

    label: Annotated[str, Field(examples=["Run #7"])]
    """The map's name"""
    components: Annotated[Sequence[str], Field(examples=[["EXX"]])]
    """Codes of its components"""
    read: Sequence[str]
    """What was read of the file, in lines of text"""


@dataclass(frozen=True, slots=True)
class StoredOnce:
    """A stored map, its machine, whether it is new and whether the active model has it.

    `made` is the version that was made with it, or the one that has it and waits; None where a
    map that was there already is in use, or in neither version. `remarks` say what is unusual
    about it.
    """

    stored: StoredMap
    machine: Machine
    is_new: bool
    in_active_model: bool
    made: MadeVersion | None
    remarks: Sequence[str]


def store_error_map(
    context: Context, machine_id: str, error_map: ErrorMap, *, accept_losses: bool = False
) -> StoredOnce:
    """Store a map, once, and make the model version that has it.

    Returns
    -------
    StoredOnce
        The stored map, and whether it is new: the same content under the same
        label again is the map that is there.

    Raises
    ------
    InvalidContent
        If a temperature is impossible, or a sensor that a component follows is missing.
    Conflict
        If the label names another map, or the map is too close to another in temperature.
    """
    (stored,) = store_error_maps(context, machine_id, [error_map], accept_losses=accept_losses)
    return stored


@repeated
def store_error_maps(
    context: Context,
    machine_id: str,
    error_maps: Sequence[ErrorMap],
    *,
    accept_losses: bool = False,
) -> list[StoredOnce]:
    """Store several maps of one machine, all of them or none; each as `store_error_map`."""
    with changing_machine(context, machine_id) as change:
        return [_store(context, change, error_map, accept_losses) for error_map in error_maps]


def _store(
    context: Context, change: MachineChange, error_map: ErrorMap, accept_losses: bool
) -> StoredOnce:
    same_map = _same_map(change, error_map)
    remarks = _remarks(change, error_map)
    if same_map is not None:
        new_version = None
        if change.waiting and _has(change.waiting, same_map) and not _has(change.version, same_map):
            new_version = activate_waiting(context, change, accept_losses=accept_losses)
        return StoredOnce(
            same_map, change.machine, False, _has(change.version, same_map), new_version, remarks
        )
    _check(context, change, error_map)
    stored = insert_error_map(change.session, change.row.id, error_map, context.now())
    new_version = make_version(context, change, _draft(change, stored), accept_losses=accept_losses)
    return StoredOnce(stored, change.machine, True, new_version.is_active, new_version, remarks)


def preview_error_map(context: Context, machine_id: str, error_map: ErrorMap) -> Preview:
    """Say what storing a map would do to the tables, and store nothing.

    Raises
    ------
    UnknownThing, InvalidContent, Conflict
        As `store_error_map`.
    """
    with reading_machine(context, machine_id) as change:
        if _same_map(change, error_map) is not None:
            reason = f"map {error_map.label!r} is there already"
            known = preview_stored(context, change, reason, change.latest)
            is_there = known.waited_before is None  # else storing it again may activate it
            return replace(known, is_there=is_there, warnings=_remarks(change, error_map))
        _check(context, change, error_map)
        # No stored map has the number nought.
        draft = _draft(change, StoredMap(0, error_map, context.now()))
        preview = preview_draft(context, change, draft)
        return replace(preview, warnings=_remarks(change, error_map))


def _same_map(change: MachineChange, error_map: ErrorMap) -> StoredMap | None:
    """Find the stored map that says the same; Conflict for another of its label."""
    same_named = find_error_map_by_label(change.session, change.row.id, error_map.label)
    if same_named is None or same_content(same_named.error_map, error_map):
        return same_named
    raise Conflict(
        f"machine {change.row.id!r} has another error map {error_map.label!r} "
        f"(number {same_named.id}); choose another label, or delete that map first"
    )


def _has(version: ModelVersion | None, stored: StoredMap) -> bool:
    return version is not None and any(m.id == stored.id for m in version.maps)


def _check(context: Context, change: MachineChange, error_map: ErrorMap) -> None:
    _check_time(context, error_map)
    _check_fits(change.machine, error_map)


def _draft(change: MachineChange, stored: StoredMap) -> Draft:
    base = change.latest
    maps = [*(base.maps if base else []), stored]
    return draft_version(change, base, maps, f"map {stored.error_map.label!r} stored")


def _remarks(change: MachineChange, error_map: ErrorMap) -> list[str]:
    """Say what is unusual about a map but no reason to refuse it."""
    machine, latest = change.machine, change.latest
    maps = [m.error_map for m in latest.maps] if latest else []
    others = [other for other in maps if other.label != error_map.label]
    recorded_c = temperatures_then(change.session, machine, error_map.measured_at)
    unrecorded_c = {s: t for s, t in error_map.temperatures_c.items() if s not in recorded_c}
    remarks = [
        *_doubted_units(error_map),
        *_doubted_errors(latest, error_map, others),
        *doubted_temperatures(error_map.temperatures_c, recorded_c),
        *exchanged_temperatures(unrecorded_c, [other.temperatures_c for other in others]),
        *table_remarks(machine, error_map.tables.values()),
    ]
    for sensor in machine.sensors.values():
        stand_in = sensor.stand_in
        temperatures_c = error_map.temperatures_c
        if stand_in and sensor.name in temperatures_c and stand_in not in temperatures_c:
            remarks.append(f"without a temperature, {stand_in} cannot stand in for {sensor.name}")
    assignment = latest.assignment if latest else {}
    unassigned = [
        code
        for code in error_map.tables
        if code not in assignment and machine.default_sensor(code) is None
    ]
    if unassigned:
        remarks.append(
            f"no sensor is assigned to {list_names(unassigned)}: tables will not have them, and "
            "nothing is compared with them. Assign one on the page Set-up, or with `thermap "
            "sensors assign`"
        )
    return remarks


def _doubted_units(error_map: ErrorMap) -> list[str]:
    """Ask whether numbers are in another unit: they would be wrong, and nothing else would say so.

    A map is not refused for it: a machine may be better, worse or hotter than any that we know.
    """
    remarks = asked_in_fahrenheit(error_map.temperatures_c.values())
    lengths = [
        errors
        for table in error_map.tables.values()
        if table.component.is_table and table.component.unit is Unit.UM
        for errors in (table.errors, table.backward_errors)
        if errors is not None
    ]
    if lengths:
        remarks += suspiciously_small("errors_um", np.concatenate(lengths))
    return remarks


def _doubted_errors(
    version: ModelVersion | None, error_map: ErrorMap, others: Sequence[ErrorMap]
) -> list[str]:
    """Ask about components that would fit the other maps if a mistake were undone.

    Tables would double such an error instead of removing it, and the change at the latest
    reading shows nothing of it while this lies between other maps.
    """
    if version is None:
        return []
    label = copied(error_map, others)
    if label is not None:
        return [f"its errors are those of map {label!r} to the last digit: is one of them a copy?"]
    remarks = []
    doubted = set()
    for mistake, codes in mistakes(error_map, others, version.assignment).items():
        doubted.update(codes)
        if mistake == REVERSED:
            remarks.append(
                f"{list_names(codes)} would fit the maps beside it with the opposite sign: are "
                "they errors, actual minus nominal, or what is to be added to the command?"
            )
        elif mistake == MIRRORED:
            remarks.append(
                f"{list_names(codes)} would fit the maps beside it with the positions the other "
                "way round: do they begin at the axis' other end?"
            )
        else:
            remarks.append(
                f"{list_names(codes)} would fit the maps beside it {mistake.factor:.4g} times as "
                "large: are these errors in the unit that is stated?"
            )
    for label, codes in inexplicable(error_map, others, version.assignment).items():
        others_codes = [code for code in codes if code not in doubted]
        if others_codes:
            remarks.append(
                f"more than temperatures explain lies between this map and map {label!r} in "
                f"{list_names(others_codes)}: are errors, unit, axis and temperatures right?"
            )
    return remarks


def table_remarks(machine: Machine, tables: Iterable[ComponentTable]) -> list[str]:
    """Say what is unusual about tables on this machine's axes."""
    remarks = []
    alone = []
    for table in tables:
        code = table.component.code
        if not table.component.is_table:
            continue
        first, last = float(table.positions_mm[0]), float(table.positions_mm[-1])
        travel = machine.axes.get(table.component.axis or "")
        if first == last:
            alone.append(code)
        elif travel is not None and not travel.holds(first, last):
            remarks.append(
                f"{code} has positions from {first:g} to {last:g} mm, beyond the axis' travel of "
                f"{travel.min_mm:g} to {travel.max_mm:g} mm"
            )
        elif travel is not None and last - first < SHORT_SHARE_OF_TRAVEL * (
            travel.max_mm - travel.min_mm
        ):
            remarks.append(
                f"{code} covers {first:g} to {last:g} mm of an axis of {travel.min_mm:g} to "
                f"{travel.max_mm:g} mm: are its positions in mm?"
            )
    if alone:
        several = len(alone) > 1
        words = (
            "have one position each: their errors count"
            if several
            else ("has one position: its error counts")
        )
        remarks.append(f"{list_names(alone)} {words} as the same on the whole axis")
    return remarks


def _check_time(context: Context, error_map: ErrorMap) -> None:
    """Refuse a measurement that is still to come."""
    now = context.now()
    if error_map.measured_at > now + FUTURE_TOLERANCE:
        raise InvalidContent.of_field(
            "measured_at",
            f"expected a time not in the future (it is {now:%Y-%m-%dT%H:%M:%SZ}), got "
            f"{error_map.measured_at:%Y-%m-%dT%H:%M:%SZ}",
        )


def _check_fits(machine: Machine, error_map: ErrorMap) -> None:
    """Refuse what this machine cannot have: its sensors' ranges, its axes, errors beyond any.

    Positions in another unit make a table that is nowhere right, and the first map of a machine
    is followed at once: so they are refused too.
    """
    errors = [
        FieldError(f"temperatures_c.{state.sensor}", state.detail)
        for state in check_temperatures(machine, error_map.temperatures_c)
        if state.health is not Health.OK
    ]
    errors += [
        FieldError(f"components.{i}.{name}", problem)
        for i, table in enumerate(error_map.tables.values())
        for name, values in (
            (table.component.input_field, table.errors),
            (table.backward_field, table.backward_errors),
        )
        if values is not None
        and (
            problem := impossible_error(table.component, values)
            or _positions_instead(table, values)
        )
    ]
    errors += _in_another_unit(machine, list(error_map.tables.values()))
    axes = {*machine.chain.axes, None}
    errors += [
        FieldError("components", f"{code} is an error of an axis that {machine.chain.text} lacks")
        for code in error_map.tables
        if COMPONENTS[code].axis not in axes
    ]
    errors += [
        FieldError("measuring_lines_mm", f"{machine.chain.text} has no axis {axis!r}")
        for axis in error_map.measuring_lines
        if axis not in axes
    ]
    if errors:
        raise InvalidContent("; ".join(e.message for e in errors), errors)


def _positions_instead(table: ComponentTable, errors: FloatArray) -> str:
    """Say that lengths are measured positions; empty if not."""
    is_length = table.component.is_table and table.component.unit is Unit.UM
    return positions_for_errors(table.positions_mm, errors) if is_length else ""


def _in_another_unit(machine: Machine, tables: Sequence[ComponentTable]) -> Iterator[FieldError]:
    """Name positions that were evidently meant in another unit, once for each axis."""
    for axis, travel in machine.axes.items():
        units = {
            i: unit
            for i, table in enumerate(tables)
            if table.component.is_table and table.component.axis == axis
            if (unit := travel.unit_meant(table.positions_mm.tolist())) is not None
        }
        for unit in sorted(set(units.values())):
            numbers = [i for i, its_unit in units.items() if its_unit == unit]
            places = np.concatenate([tables[i].positions_mm for i in numbers])
            codes = list_names(tables[i].component.code for i in numbers)
            yield FieldError(
                f"components.{numbers[0]}.positions_mm",
                f"expected positions of {codes} in mm, on an axis of {travel.min_mm:g} to "
                f"{travel.max_mm:g} mm, got {places.min():g} to {places.max():g} mm: were they "
                f"meant in {unit}, or is the travel of {axis} stated in another unit?",
            )


@repeated
def withdraw_map(context: Context, machine_id: str, map_id: int) -> None:
    """Delete a map from the machine; versions made of it keep it.

    If the active version contains it, the next version is the same without it, and active
    whatever it loses: that is what deleting means. A version that waits is made anew without it.
    """
    with changing_machine(context, machine_id) as change:
        row = find_error_map(change.session, machine_id, map_id)
        withdraw_error_map(row, context.now())
        waiting = change.waiting
        draft = _without(change, row)
        if draft is not None:
            make_version(context, change, draft, accept_losses=True)
        if waiting is not None and any(m.id == map_id for m in waiting.maps):
            remake_waiting(context, change, waiting, without=[map_id])


def preview_withdrawal(context: Context, machine_id: str, map_id: int) -> Preview:
    """Say what deleting a map would do to the tables, and delete nothing."""
    with reading_machine(context, machine_id) as change:
        row = find_error_map(change.session, machine_id, map_id)
        draft = _without(change, row)
        if draft is None:
            reason = f"map {row.label!r} deleted, which the active model does not have"
            return preview_stored(context, change, reason, change.version)
        return preview_draft(context, change, draft, activates=True)


def _without(change: MachineChange, row: ErrorMapRow) -> Draft | None:
    """Put the active version together without a map; None where it does not have that map."""
    active = change.version
    if active is None or all(stored.id != row.id for stored in active.maps):
        return None
    remaining = [stored for stored in active.maps if stored.id != row.id]
    return draft_version(change, active, remaining, f"map {row.label!r} deleted")
