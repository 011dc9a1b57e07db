"""Rebuild from stored readings what a machine's adopted effects need of the past."""

from __future__ import annotations

from datetime import timedelta

from app.live.registry import LiveMachine
from app.services.context import Context
from app.storage.readings import recent_readings
from app.thermal.reading import Reading


def restore_past(context: Context, live: LiveMachine) -> None:
    """Restore a machine's filters and states, if readings came that they could not take.

    Raises
    ------
    StorageUnavailable
        If the database is away; the past stays as it was, and can be restored later.
    """
    past = live.past
    machine_id = live.current.model.machine.id

    def stored() -> list[Reading]:
        with context.database.reading() as session:
            return recent_readings(session, machine_id, timedelta(seconds=past.record_s), ())

    past.restore(stored)
