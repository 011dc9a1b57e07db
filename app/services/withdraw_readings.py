"""Take readings out of use that never should have been: a clock or a sensor was wrong."""

from __future__ import annotations

from contextlib import suppress
from datetime import datetime

from app.errors import InvalidContent, StorageUnavailable, UnknownThing
from app.services.context import Context
from app.services.live_table import exact_time
from app.services.repeating import repeated
from app.services.restore_past import restore_past
from app.storage.machines import Held, find_machine
from app.storage.readings import withdraw_stored


def withdraw_reading(context: Context, machine_id: str, time: datetime) -> int:
    """Withdraw the reading of one time; there is 1.

    Raises
    ------
    UnknownThing
        If there is no such machine, or no reading of that time.
    """
    count = withdraw_readings(context, machine_id, time, time)
    if not count:
        raise UnknownThing(
            f"machine {machine_id!r} has no reading of {exact_time(time)}: its time is expected "
            "with all its digits, or a range from … to …"
        )
    return count


@repeated
def withdraw_readings(context: Context, machine_id: str, since: datetime, until: datetime) -> int:
    """Withdraw the readings between two times, both included; say how many there were.

    They count nowhere from then on, and the same may be stored again.

    Raises
    ------
    UnknownThing
        If there is no such machine.
    InvalidContent
        If the second time is before the first.
    """
    if until < since:
        raise InvalidContent.of_field(
            "to", f"expected a time not before {exact_time(since)}, came {exact_time(until)}"
        )
    with context.database.writing() as session:
        machine = find_machine(session, machine_id, Held.CHANGED)
        count = withdraw_stored(session, machine, since, until, context.now())
    live = context.live.get(machine_id)
    if count and live is not None:
        live.withdraw(since, until)
        with suppress(StorageUnavailable, UnknownThing):  # the follower tries again
            restore_past(context, live)
    return count
