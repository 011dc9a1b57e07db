"""The compensation table from memory: for stated temperatures, or for the latest reading."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from hashlib import blake2s

from app.compensation.table import CompensationTable, compensation_table
from app.errors import NoReading, SensorUnavailable
from app.live.registry import LiveMachine, LiveModel
from app.services.context import Context
from app.thermal.reading import Reading
from app.thermal.sensor_health import Health, SensorState, check_temperatures, grow_older

CLOCKS_DIFFER_S = 60.0
"""A reading may be ahead of the service's clock by this much [s]."""


@dataclass(frozen=True, slots=True)
class CurrentState:
    """The latest reading, every sensor's state now, and a tag that changes when they do."""

    reading: Reading
    age_s: float
    sensors: Sequence[SensorState]
    tag: str


@dataclass(frozen=True, slots=True)
class CurrentTable:
    """The table at the latest reading, and what it rests on."""

    table: CompensationTable
    state: CurrentState


def table_at(
    current: LiveModel,
    temperatures_c: Mapping[str, float],
    now: datetime,
    warnings: Iterable[str] = (),
) -> CompensationTable:
    """Compute the table for temperatures [°C] that the caller states.

    Raises
    ------
    InvalidContent
        If a sensor is unknown, missing or its unit mistaken, if the maps are too
        few, or if the temperatures are outside what the machine's policy allows.
    """
    return compensation_table(
        current.model,
        current.version or 0,
        check_temperatures(current.model.machine, temperatures_c),
        now,
        warnings,
    )


def current_state(context: Context, machine_id: str, live: LiveMachine) -> CurrentState:
    """Judge the sensors at this moment.

    Raises
    ------
    NoReading
        If the machine has had no reading.
    """
    latest = live.readings.latest
    machine = live.current.model.machine
    if latest is None:
        raise NoReading(f"machine {machine_id!r} has no reading yet: POST one to …/readings")
    age_s = (context.now() - latest.time).total_seconds()
    sensors = grow_older(machine, live.readings.judge(machine), max(age_s, 0.0))
    away = context.live.database_away_since
    facts = [(s.sensor, s.health, s.temperature_c) for s in sensors]
    stamp = repr((live.current.stamp, live.current.version, latest.time, facts, away))
    return CurrentState(latest, age_s, sensors, blake2s(stamp.encode(), digest_size=12).hexdigest())


def current_table(context: Context, live: LiveMachine, state: CurrentState) -> CurrentTable:
    """Compute the table at the latest reading.

    Stale sensors serve where no stand-in is fresh, and are said; a sensor that
    failed otherwise has its stand-in or none.

    Raises
    ------
    NoReading
        If a sensor that components follow cannot be believed and has no stand-in.
    NotEnoughMaps, OutsideMaps
        As `compensation_table`.
    """
    current = live.current
    try:
        table = compensation_table(
            current.model,
            current.version or 0,
            state.sensors,
            context.now(),
            [*database_warnings(context, live.current), *_clock_warnings(state)],
        )
    except SensorUnavailable as error:
        raise NoReading(error.detail) from None
    return CurrentTable(table, state)


def database_warnings(context: Context, current: LiveModel) -> list[str]:
    """Say since when the database is away, and how old the model is that goes on without it."""
    away_since = context.live.database_away_since
    if away_since is None:
        return []
    now = context.now()
    return [
        f"the database has been away for {_seconds(away_since, now):.0f} s: model version "
        f"{current.version} goes on from memory, where it has been for "
        f"{_seconds(current.loaded_at, now):.0f} s"
    ]


def _clock_warnings(state: CurrentState) -> list[str]:
    """Say that the latest reading lies in the future: a clock was wrong, or is."""
    if state.age_s >= -CLOCKS_DIFFER_S:
        return []
    return [
        f"the latest reading is {-state.age_s:.0f} s in the future: a clock is wrong, and newer "
        "readings do not count until then"
    ]


def is_stale(state: CurrentState) -> bool:
    """Whether any sensor's value is too old."""
    return any(s.health is Health.STALE for s in state.sensors)


def _seconds(since: datetime, now: datetime) -> float:
    return (now - since).total_seconds()
