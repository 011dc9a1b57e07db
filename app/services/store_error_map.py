"""Store an error map and make the model version that contains it."""

from __future__ import annotations

from app.errors import Conflict, FieldError, InvalidContent
from app.geometry.components import COMPONENTS
from app.services.change_model import changing_machine, next_version
from app.services.context import Context
from app.storage.error_maps import find_label, insert_error_map, same_content
from app.storage.records import StoredMap
from app.thermal.error_map import ErrorMap
from app.thermal.machine import Machine
from app.thermal.sensor_health import Health, check_temperatures


def store_error_map(
    context: Context, machine_id: str, error_map: ErrorMap
) -> tuple[StoredMap, bool]:
    """Store a map, once.

    Returns
    -------
    StoredMap, bool
        The stored map, and whether it is new: the same content under the same
        label again is the map that is there.

    Raises
    ------
    InvalidContent
        If a temperature is impossible, or a sensor that a component follows is missing.
    Conflict
        If the label names another map, or the map is too close to another in temperature.
    """
    with changing_machine(context, machine_id) as change:
        known = find_label(change.session, machine_id, error_map.label)
        if known is not None:
            if same_content(known.error_map, error_map):
                return known, False
            raise Conflict(
                f"machine {machine_id!r} has another error map {error_map.label!r} "
                f"(number {known.id}); choose another label, or delete that map first"
            )
        _check_fits(change.machine, error_map)
        stored = insert_error_map(change.session, machine_id, error_map, context.now())
        before = change.version.maps if change.version else []
        next_version(context, change, [*before, stored], f"map {error_map.label!r} stored")
    return stored, True


def remarks(machine: Machine, error_map: ErrorMap) -> list[str]:
    """Say what is unusual about a map but no reason to refuse it."""
    found = []
    for code, table in error_map.tables.items():
        travel = machine.axes.get(table.component.axis or "")
        if travel is not None and (
            table.positions_mm[0] < travel.min_mm or table.positions_mm[-1] > travel.max_mm
        ):
            found.append(
                f"{code} has positions from {table.positions_mm[0]:g} to "
                f"{table.positions_mm[-1]:g} mm, beyond the axis' travel of "
                f"{travel.min_mm:g} to {travel.max_mm:g} mm"
            )
    return found


def _check_fits(machine: Machine, error_map: ErrorMap) -> None:
    """Refuse what this machine cannot have: its sensors' ranges, its axes."""
    errors = [
        FieldError(f"temperatures_c.{state.sensor}", state.detail)
        for state in check_temperatures(machine, error_map.temperatures_c)
        if state.health is not Health.OK
    ]
    axes = {*machine.chain.axes, None}
    errors += [
        FieldError("components", f"{code} is an error of an axis that {machine.chain.text} lacks")
        for code in error_map.tables
        if COMPONENTS[code].axis not in axes
    ]
    errors += [
        FieldError("measuring_lines_mm", f"{machine.chain.text} has no axis {axis!r}")
        for axis in error_map.measuring_lines_mm
        if axis not in axes
    ]
    if errors:
        raise InvalidContent("; ".join(e.message for e in errors), errors)
