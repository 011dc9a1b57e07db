"""Change a machine's settings."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from app.effects.past import sensors_of
from app.errors import Conflict, list_names
from app.geometry.components import COMPONENTS
from app.services.change_model import changing_machine
from app.services.context import Context
from app.services.load_machine import adopted_effects
from app.services.repeating import repeated
from app.storage.error_maps import list_error_maps
from app.storage.machines import stored_machine, update_machine
from app.storage.records import ModelVersion, StoredMachine, StoredMap
from app.storage.watches import watch_status
from app.thermal.machine import Machine


@repeated
def change_machine(
    context: Context, machine_id: str, edit: Callable[[Machine], Machine]
) -> StoredMachine:
    """Apply an edit to a machine as it is at that moment.

    Parameters
    ----------
    context
        The service.
    machine_id
        Which machine.
    edit
        Makes the new description from the present one, under the machine's lock.

    Raises
    ------
    Conflict
        If a sensor or an axis goes that maps or the assignment use, or maps
        become too close for a sensor's new resolution.
    """
    with changing_machine(context, machine_id) as change:
        before = change.machine
        after = edit(before)
        maps = list_error_maps(change.session, machine_id)
        _check_sensors_stay(before, after, maps, [change.version, change.waiting])
        _check_axes_stay(after, maps)
        update_machine(change.row, after)
        watched = watch_status(change.session, change.row)
    return replace(stored_machine(change.row), watch=watched)


def _check_sensors_stay(
    before: Machine,
    after: Machine,
    maps: list[StoredMap],
    versions: Iterable[ModelVersion | None],
) -> None:
    gone = set(before.sensors) - set(after.sensors)
    in_maps = {name for m in maps for name in m.error_map.temperatures_c}
    used = set(in_maps)
    for version in versions:
        used |= set(version.assignment.values()) if version else set()
        used |= sensors_of(adopted_effects(version))
    still_used = sorted(gone & used)
    if still_used:
        raise Conflict(
            f"sensors {list_names(still_used)} cannot go: error maps, the sensor assignment or "
            "adopted effects use them"
        )


def _check_axes_stay(after: Machine, maps: list[StoredMap]) -> None:
    moved = {COMPONENTS[code].axis for m in maps for code in m.error_map.tables}
    missing = sorted(axis for axis in moved if axis and axis not in after.chain.axes)
    if missing:
        raise Conflict(
            f"configuration {after.chain.text} lacks axes {list_names(missing)} of stored maps"
        )
