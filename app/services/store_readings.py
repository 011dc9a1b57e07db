"""Store readings, once each, and let the live table follow."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from typing import Final

from app.errors import (
    Conflict,
    FieldError,
    InvalidContent,
    StorageUnavailable,
    UnknownThing,
)
from app.live.registry import Arrived
from app.services.context import CLOCKS_DIFFER, Context
from app.services.live_table import ahead_warnings, exact_time
from app.services.load_machine import load_machine
from app.services.repeating import repeated
from app.services.restore_past import restore_past
from app.storage.machines import Held, find_machine, stored_machine
from app.storage.readings import find_readings, insert_readings
from app.thermal.machine import Machine
from app.thermal.reading import Reading
from app.thermal.sensor_health import check_temperatures

MOST_AHEAD_OF_CLOCK: Final = timedelta(days=1)
"""Wrong clocks and zones put a reading less far ahead; what lies further is refused."""


@dataclass(frozen=True, slots=True)
class StoreOutcome:
    """How many readings are new, how many were there already, and what is to be said of them.

    `ahead` counts those of both that lie in the future.
    """

    stored: int
    duplicates: int
    ahead: int
    warnings: Sequence[str]


@repeated
def store_readings(context: Context, machine_id: str, readings: Sequence[Reading]) -> StoreOutcome:
    """Store readings whole or not at all.

    Those that lie in the future are stored, said to be so, and used when their time comes;
    tables go on saying that they came early.

    Raises
    ------
    InvalidContent
        If a sensor is unknown, a unit mistaken, or a time too far in the future. A value
        out of its sensor's range is stored: it is the sensor's failure, and says so.
    Conflict
        If a time has a reading with other content.
    """
    now = context.now()
    with context.database.writing() as session:
        row = find_machine(session, machine_id, Held.KEPT)
        _check(now, stored_machine(row).machine, readings)
        once = [_as_it_arrived(reading, now) for reading in _each_time_once(readings)]
        added = insert_readings(session, machine_id, once)
        repeated = [r for r in once if r.time not in added]
        known = find_readings(session, machine_id, [r.time for r in repeated])
        for reading in repeated:
            # One that is not known any more was withdrawn in between.
            if known.get(reading.time, reading) != reading:
                raise _other_content(known[reading.time], reading)
    until = context.usable_until()
    # They are stored: what goes wrong now is put right later.
    with suppress(StorageUnavailable, UnknownThing):
        live = context.live.get(machine_id) or load_machine(context, machine_id)
        live.add(Arrived([r for r in once if r.time in added], row.withdrawals), until)
        restore_past(context, live)
    ahead = [reading for reading in once if reading.time > until]
    warnings = ahead_warnings(ahead)
    return StoreOutcome(len(added), len(readings) - len(added), len(ahead), warnings)


def _as_it_arrived(reading: Reading, now: datetime) -> Reading:
    """Note on a reading that it came before its time."""
    ahead = reading.time - now
    return replace(reading, early_s=ahead.total_seconds()) if ahead > CLOCKS_DIFFER else reading


def _check(now: datetime, machine: Machine, readings: Sequence[Reading]) -> None:
    latest = now + MOST_AHEAD_OF_CLOCK
    for i, reading in enumerate(readings):
        if reading.time > latest:
            message = (
                "expected a time not in the future, or at most a day ahead of the service's clock "
                f"(it is {exact_time(now)}), came {exact_time(reading.time)}: one of the clocks is "
                "wrong, or the time's zone"
            )
            raise InvalidContent(message, [FieldError(f"{i}.time", message)])
        try:
            check_temperatures(machine, reading.temperatures_c)
        except InvalidContent as error:
            raise error.inside(str(i)) from None


def _each_time_once(readings: Sequence[Reading]) -> list[Reading]:
    by_time: dict[datetime, Reading] = {}
    for reading in readings:
        first = by_time.setdefault(reading.time, reading)
        if first != reading:
            raise _other_content(first, reading)
    # In order of time, so that two writers of overlapping batches queue in one direction.
    return sorted(by_time.values(), key=lambda reading: reading.time)


def _other_content(known: Reading, came: Reading) -> Conflict:
    return Conflict(
        f"the reading of {came.time:%Y-%m-%dT%H:%M:%S.%fZ} is known with other content: "
        f"{dict(known.temperatures_c)} °C, state {dict(known.state)}; came "
        f"{dict(came.temperatures_c)} °C, state {dict(came.state)}"
    )
