"""Store readings, once each, and let the live table follow."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime

from app.errors import Conflict, FieldError, InvalidContent, StorageUnavailable, UnknownThing
from app.services.context import FUTURE_TOLERANCE, Context
from app.services.load_machine import load_machine
from app.services.restore_past import restore_past
from app.storage.machines import find_machine, stored_machine
from app.storage.readings import find_readings, insert_readings
from app.thermal.machine import Machine
from app.thermal.reading import Reading
from app.thermal.sensor_health import check_temperatures


def store_readings(
    context: Context, machine_id: str, readings: Sequence[Reading]
) -> tuple[int, int]:
    """Store readings whole or not at all.

    Returns
    -------
    int, int
        How many were stored, and how many were there already.

    Raises
    ------
    InvalidContent
        If a sensor is unknown, a unit mistaken, or a time in the future. A value
        out of its sensor's range is stored: it is the sensor's failure, and says so.
    Conflict
        If a time has a reading with other content.
    """
    with context.database.writing() as session:
        machine = stored_machine(find_machine(session, machine_id)).machine
        _check(context, machine, readings)
        once = _each_time_once(readings)
        added = insert_readings(session, machine_id, once)
        repeated = [r for r in once if r.time not in added]
        known = find_readings(session, machine_id, [r.time for r in repeated])
        for reading in repeated:
            if reading.time not in known:  # the machine went in between
                find_machine(session, machine_id)
            elif known[reading.time] != reading:
                raise _other_content(known[reading.time], reading)
    # They are stored: what goes wrong now is put right later.
    with suppress(StorageUnavailable, UnknownThing):
        live = context.live.get(machine_id) or load_machine(context, machine_id)
        live.add(r for r in once if r.time in added)
        restore_past(context, live)
    return len(added), len(readings) - len(added)


def _check(context: Context, machine: Machine, readings: Sequence[Reading]) -> None:
    latest = context.now() + FUTURE_TOLERANCE
    for i, reading in enumerate(readings):
        if reading.time > latest:
            message = (
                f"expected a time not in the future (it is {context.now():%Y-%m-%dT%H:%M:%SZ}), "
                f"came {reading.time:%Y-%m-%dT%H:%M:%SZ}"
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
