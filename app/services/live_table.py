"""The compensation table from memory: for stated temperatures, or for the latest reading."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from hashlib import blake2s

from app.compensation.table import CompensationTable, compensation_table
from app.errors import NoReading, SensorUnavailable
from app.identification.conditions import Conditions, Lags
from app.identification.effects_in_table import add_effects, faulty_marked
from app.identification.live_lags import LiveLags
from app.live.registry import LiveMachine, LiveModel
from app.services.context import Context
from app.thermal.reading import Reading
from app.thermal.sensor_health import Health, SensorState, check_temperatures, grow_older

CLOCKS_DIFFER_S = 60.0
"""A reading may be ahead of the service's clock by this much [s]."""

TAGGED_DIGITS = 9
"""Digits of a filter's output that count for the tag: two services may differ in the last."""

_SERVING = frozenset({Health.OK, Health.STALE, Health.FAULTY})
"""Sensors whose temperature drives effects: those that were fitted to faulty readings too."""


@dataclass(frozen=True, slots=True)
class CurrentState:
    """The latest reading, every sensor's state now, and a tag that changes when they do.

    `current` is the model that holds, and `moment` what drives its adopted effects, at the
    latest reading; None without any.
    """

    current: LiveModel
    reading: Reading
    age_s: float
    sensors: Sequence[SensorState]
    moment: Conditions | None
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
    state: Mapping[str, float] | None = None,
) -> CompensationTable:
    """Compute the table for temperatures [°C] that the caller states.

    Adopted effects act as far as these temperatures, the machine's state as stated, and
    the time `now` drive them: nothing is known of the past.

    Raises
    ------
    InvalidContent
        If a sensor is unknown, missing or its unit mistaken, if the maps are too
        few, or if the temperatures are outside what the machine's policy allows.
    """
    sensors = check_temperatures(current.model.machine, temperatures_c)
    moment = None
    if current.effects:
        moment = _moment(now.timestamp(), sensors, state)
        sensors = faulty_marked(current.model, current.effects, moment, sensors)
    return _table(current, sensors, moment, now, warnings)


def current_state(
    context: Context,
    machine_id: str,
    live: LiveMachine,
    stated: Mapping[str, float] | None = None,
) -> CurrentState:
    """Judge the sensors at this moment.

    What is stated of the machine's state goes before what the readings say of it.

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
    current, past, time_s = live.current, live.past.now, latest.time.timestamp()
    moment = None
    if current.effects:
        states = past.states_at(time_s) | dict(stated or {})
        moment = _moment(time_s, sensors, states, past.lags)
        sensors = faulty_marked(current.model, current.effects, moment, sensors)
    away = context.live.database_away_since
    facts = [(s.sensor, s.health, s.temperature_c) for s in sensors]
    stamp = repr((current.stamp, current.version, latest.time, facts, away, _driving(moment)))
    tag = blake2s(stamp.encode(), digest_size=12).hexdigest()
    return CurrentState(current, latest, age_s, sensors, moment, tag)


def current_table(context: Context, state: CurrentState) -> CurrentTable:
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
    try:
        warnings = [*database_warnings(context, state.current), *_clock_warnings(state)]
        table = _table(state.current, state.sensors, state.moment, context.now(), warnings)
    except SensorUnavailable as error:
        raise NoReading(error.detail) from None
    return CurrentTable(table, state)


def _moment(
    time_s: float,
    sensors: Iterable[SensorState],
    states: Mapping[str, float] | None,
    lags: Lags | None = None,
) -> Conditions:
    temperatures_c = {
        s.sensor: s.temperature_c
        for s in sensors
        if s.temperature_c is not None and s.health in _SERVING
    }
    return Conditions.of_moment(time_s, temperatures_c, states, lags)


def _driving(moment: Conditions | None) -> list[tuple[str, str]]:
    """Write the states and the filters' outputs that drive effects, for comparison."""
    if moment is None:
        return []
    lags = moment.lags
    filters = lags.filters if isinstance(lags, LiveLags) else {}
    driving = [(repr(key), moment.lagged(*key)) for key in filters]
    driving += [(name, value) for name, value in moment.states.items()]
    return sorted((name, f"{float(value[0]):.{TAGGED_DIGITS}g}") for name, value in driving)


def _table(
    current: LiveModel,
    sensors: Sequence[SensorState],
    moment: Conditions | None,
    now: datetime,
    warnings: Iterable[str],
) -> CompensationTable:
    """Compute the table of the maps, and add what effects there are."""
    table = compensation_table(current.model, current.version or 0, sensors, now, warnings)
    if moment is None:
        return table
    stale = {s.sensor for s in sensors if s.health is Health.STALE}
    return add_effects(table, current.model, current.effects, moment, stale)


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
