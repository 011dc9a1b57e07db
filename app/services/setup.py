"""What the page of a machine's set-up shows: what there is, what is missing, what comes next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from app.services.context import Context
from app.services.status import machine_in_memory, status_of, stored_of_machines
from app.status.machine_status import MachineStatus
from app.storage.machines import find_machine
from app.storage.model_versions import active_version, waiting_version
from app.storage.records import ModelVersion
from app.thermal.machine import Machine
from app.thermal.sensor_assignment import Proposal, propose_assignment


@dataclass(frozen=True, slots=True, eq=False)
class SetupView:
    """A machine, its newest version, and the sensors that its maps speak for.

    `version` is the one that waits, where one waits: it has all that was stored, and the next
    assignment is made of it. None before the first map.
    """

    status: MachineStatus
    machine: Machine
    version: ModelVersion | None = None
    proposals: Sequence[Proposal] = ()


def show_setup(context: Context, machine_id: str) -> SetupView:
    """Gather what the page of a machine's set-up shows."""
    live = machine_in_memory(context, machine_id)
    status = status_of(context, live, stored_of_machines(context))
    machine = live.current.model.machine
    with context.database.reading() as session:
        row = find_machine(session, machine_id)
        version = waiting_version(session, row) or active_version(session, row)
    if version is None:
        return SetupView(status, machine)
    maps = [stored.error_map for stored in version.maps]
    return SetupView(
        status, machine, version, propose_assignment(machine, maps, version.assignment)
    )
