"""What the page of maps and versions shows: all versions, and two of them side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from app.services.context import Context
from app.services.models import PresentChange, compare_now
from app.services.status import machine_in_memory, status_of, stored_of_machines
from app.status.machine_status import MachineStatus
from app.storage.machines import find_machine
from app.storage.model_versions import list_versions
from app.storage.records import ModelVersion


@dataclass(frozen=True, slots=True, eq=False)
class MapsView:
    """A machine's versions, oldest first; which is active, which waits, and which are compared.

    `compared` says by how much tables with `b` differ from those with `a` now; None where there
    are not two versions.
    """

    status: MachineStatus
    sensors: Sequence[str]
    versions: Sequence[ModelVersion]
    active: int | None
    waiting: int | None
    a: int | None = None
    b: int | None = None
    compared: PresentChange | None = None

    @property
    def active_version(self) -> ModelVersion | None:
        """The version that tables follow."""
        return next((version for version in self.versions if version.version == self.active), None)


def show_maps_view(
    context: Context, machine_id: str, a: int | None = None, b: int | None = None
) -> MapsView:
    """Gather what the page of maps and versions shows.

    Parameters
    ----------
    a, b
        The two versions to compare; without them the active one, with the one before it.
    """
    live = machine_in_memory(context, machine_id)
    status = status_of(context, live, stored_of_machines(context))
    sensors = tuple(live.current.model.machine.sensors)
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        active, waiting = row.active_version, row.waiting_version
        versions = list_versions(session, machine_id)
    numbers = [version.version for version in versions]
    if active is None or len(numbers) < 2:
        return MapsView(status, sensors, versions, active, waiting)
    b = b or active
    a = a or next((n for n in reversed(numbers) if n < b), next(n for n in numbers if n != b))
    compared = compare_now(context, machine_id, a, b)
    return MapsView(status, sensors, versions, active, waiting, a, b, compared)
