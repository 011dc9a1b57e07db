"""Read from storage what a machine in memory lacks: readings, and what its effects need of them."""

from __future__ import annotations

from datetime import timedelta

from app.live.reading_window import MOST_AHEAD
from app.live.registry import Arrived, LiveMachine
from app.services.context import Context
from app.storage.machines import find_machine
from app.storage.readings import readings_after, recent_readings
from app.thermal.reading import Reading
from app.thermal.sensor_health import record_needed_s


def restore_past(context: Context, live: LiveMachine) -> None:
    """Restore a machine's readings, filters and states, where they are behind.

    Raises
    ------
    UnknownThing
        If the machine was deleted.
    StorageUnavailable
        If the database is away; all stays as it was, and can be restored later.
    """
    if live.is_behind:
        _reread(context, live)
    past = live.past
    machine_id = live.current.model.machine.id

    def stored() -> list[Reading]:
        record = timedelta(seconds=past.record_s)
        with context.database.reading() as session:
            return recent_readings(session, machine_id, context.usable_until(), record, ())

    past.restore(stored)


def lacks_reading(context: Context, live: LiveMachine) -> bool:
    """Whether memory has no reading that can be used now, but the database may have."""
    live.keep_up(context.usable_until())
    return live.is_behind and live.readings.latest is None


def _reread(context: Context, live: LiveMachine) -> None:
    """Read the latest readings that can be used, and the first of those that lie ahead."""
    machine, until = live.current.model.machine, context.usable_until()
    window = timedelta(seconds=record_needed_s(machine.sensors.values()))
    with live.noting_arrivals() as meanwhile:
        with context.database.reading() as session:
            # First of all: what is withdrawn from now on counts as not yet withdrawn.
            withdrawals = find_machine(session, machine.id).withdrawals
            recent = recent_readings(session, machine.id, until, window, machine.sensors)
            ahead = readings_after(session, machine.id, until, MOST_AHEAD + 1)
        live.reread(Arrived([*recent, *ahead], withdrawals), meanwhile, until)
