"""Read verifications with a model version and the readings around them."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import Final

from sqlalchemy.orm import Session

from app.effects.observations import Verification
from app.effects.past import needed_past
from app.identification.campaign import Campaign
from app.services.load_machine import adopted_effects, compile_version
from app.storage.readings import list_readings
from app.storage.records import ModelVersion
from app.storage.verifications import find_verification, read_verification
from app.thermal.machine import Machine
from app.thermal.sensor_health import record_needed_s
from app.thermal.temperature_history import TemperatureHistory

SEARCHED_BACK: Final = timedelta(days=3)
"""Readings before the first observation that a search takes in: an effect with a time constant
needs five of them."""


def read_verifications(
    session: Session, machine_id: str, verification_ids: Sequence[int]
) -> list[Verification]:
    """Read verifications with their observations; UnknownThing if one is not there."""
    rows = (find_verification(session, machine_id, i, observations=True) for i in verification_ids)
    return [read_verification(row) for row in rows]


def load_campaign(
    session: Session,
    machine: Machine,
    version: ModelVersion,
    verifications: Sequence[Verification],
    until: datetime,
    *,
    searching: bool = False,
    recorded: tuple[datetime, datetime] | None = None,
) -> Campaign:
    """Set verifications beside a model version and what was recorded.

    Parameters
    ----------
    session
        To read the readings in.
    machine, version
        What is held against the verifications.
    verifications
        At least one.
    until
        The latest time at which a reading can have been measured: later ones do not count yet.
    searching
        Whether effects are looked for: that takes more of the past than the effects that
        the version has adopted.
    recorded
        From when to when readings are needed; around the observations where nothing is stated.

    Raises
    ------
    InvalidContent, Conflict
        As `compile_version`.
    """
    effects = adopted_effects(version)
    around = timedelta(seconds=record_needed_s(machine.sensors.values()))
    past = max(around, timedelta(seconds=needed_past(effects).record_s))
    if searching:
        past = max(past, SEARCHED_BACK)
    first, last = recorded or first_and_last(verifications)
    readings = [
        (r.time.timestamp(), r)
        for r in list_readings(session, machine.id, first - past, min(last + around, until))
    ]
    return Campaign(
        model=compile_version(machine, version),
        maps=[stored.error_map for stored in version.maps],
        verifications=verifications,
        readings=TemperatureHistory.of_readings(
            machine.sensors, [(time_s, r.temperatures_c) for time_s, r in readings]
        ),
        state_readings=[(time_s, r.state) for time_s, r in readings],
        effects=effects,
    )


def first_and_last(verifications: Sequence[Verification]) -> tuple[datetime, datetime]:
    """Give the times of the first and the last observation."""
    times_s = [o.time_s for v in verifications for o in v.observations]
    return datetime.fromtimestamp(min(times_s), UTC), datetime.fromtimestamp(max(times_s), UTC)
