"""The compensation table from memory: for stated temperatures, or for the latest reading."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from hashlib import blake2s

from app.compensation.table import CompensationTable, compensation_table
from app.effects.adopted.in_table import add_effects, faulty_marked
from app.effects.adopted.live_lags import LiveLags
from app.effects.conditions import Conditions, Lags
from app.errors import NoReading, SensorUnavailable, counted
from app.live.reading_window import HeldReadings
from app.live.registry import LiveMachine, LiveModel
from app.services.context import Context
from app.thermal.reading import Reading
from app.thermal.sensor_health import Health, SensorState, check_temperatures, grow_older
from app.units import exact_time

TAGGED_DIGITS = 9
"""Digits of a filter's output that count for the tag: two services may differ in the last."""

_SERVING = frozenset({Health.OK, Health.STALE, Health.FAULTY})
"""Sensors whose temperature drives effects: those that were fitted to faulty readings too."""


@dataclass(frozen=True, slots=True)
class CurrentState:
    """The latest reading, every sensor's state now, and a tag that changes when they do.

    `current` is the model that holds, and `moment` what drives its adopted effects, at the
    latest reading; None without any. `ahead` are the readings that lie in the future, in order
    of time, and are not used yet; with `more_ahead` only the first of them. `early` are those in
    use that arrived before their time.
    """

    current: LiveModel
    reading: Reading
    age_s: float
    sensors: Sequence[SensorState]
    moment: Conditions | None
    ahead: Sequence[Reading]
    more_ahead: bool
    early: Sequence[Reading]
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
    declared_state: Mapping[str, float] | None = None,
) -> CurrentState:
    """Judge the sensors at this moment.

    What is stated of the machine's state takes precedence over what the readings say of it.

    Raises
    ------
    NoReading
        If the machine has had no reading, or none but such as lie in the future.
    """
    live.advance_to(context.usable_until())
    window = live.readings.held
    latest = window.latest
    machine = live.current.model.machine
    if latest is None:
        raise _no_reading(context, machine_id, window)
    # One that is ahead by no more than clocks differ is of now.
    age_s = max(0.0, (context.now() - latest.time).total_seconds())
    sensors = grow_older(machine, live.readings.judge(machine), age_s)
    current, past, time_s = live.current, live.past.now, latest.time.timestamp()
    moment = None
    if current.effects:
        states = past.states_at(time_s) | dict(declared_state or {})
        moment = _moment(time_s, sensors, states, past.lags)
        sensors = faulty_marked(current.model, current.effects, moment, sensors)
    trouble = context.live.database.trouble
    facts = [(s.sensor, s.health, s.temperature_c) for s in sensors]
    ahead = (len(window.ahead), window.more_ahead, window.ahead and _between(window.ahead))
    early = [(reading.time, reading.early_s) for reading in window.early]
    facts_of_all = (current.stamp, current.version, latest, facts, trouble, _driving(moment))
    tag = blake2s(repr((*facts_of_all, ahead, early)).encode(), digest_size=12).hexdigest()
    return CurrentState(
        current, latest, age_s, sensors, moment, window.ahead, window.more_ahead, window.early, tag
    )


def current_table(context: Context, state: CurrentState) -> CurrentTable:
    """Compute the table at the latest reading.

    Stale sensors serve where no stand-in is fresh, and are said; a sensor that
    failed otherwise has its stand-in or none. A table that rests on a reading that arrived
    before its time says so and is not complete: nobody can have measured that.

    Raises
    ------
    NoReading
        If a sensor that components follow cannot be believed and has no stand-in.
    NotEnoughMaps, OutsideMaps
        As `compensation_table`.
    """
    try:
        table = table_of_state(context, state)
    except SensorUnavailable as error:
        raise NoReading(error.detail) from None
    return CurrentTable(table, state)


def table_of_state(context: Context, state: CurrentState) -> CompensationTable:
    """Compute the same; SensorUnavailable where a sensor is missing."""
    clocks = [
        *early_warnings(state.early),
        *ahead_warnings(state.ahead, more_ahead=state.more_ahead),
    ]
    warnings = [*database_warnings(context, state.current), *clocks]
    table = _table(state.current, state.sensors, state.moment, context.now(), warnings)
    return table._replace(complete=False) if state.early else table


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
    """Say what is the matter with the database, and how old the model is that goes on."""
    trouble = context.live.database.trouble
    if trouble is None:
        return []
    now = context.now()
    return [
        f"the database {trouble.matter.value} for {_seconds(trouble.since, now):.0f} s: "
        f"model version {current.version} goes on from memory, where it has been for "
        f"{_seconds(current.loaded_at, now):.0f} s"
    ]


def ahead_warnings(ahead: Sequence[Reading], *, more_ahead: bool = False) -> list[str]:
    """Name readings that lie in the future, in order of time, and say what to do about them."""
    if not ahead:
        return []
    number = f"more than {len(ahead):,} readings" if more_ahead else counted(len(ahead), "reading")
    whose = "its" if len(ahead) == 1 and not more_ahead else "their"
    return [
        f"{number} from the future, not used before {whose} time comes: {_between(ahead)}; a "
        "clock is wrong, set it right and withdraw what is stamped wrongly"
    ]


def old_warnings(old: Sequence[Reading]) -> list[str]:
    """Name readings of so long ago that a clock may be wrong, in order of time."""
    if not old:
        return []
    return [
        f"{counted(len(old), 'reading')} from more than ten years ago: {_between(old)}; if they "
        "were not recorded then, a clock is wrong: set it right and withdraw what is stamped "
        "wrongly"
    ]


def early_warnings(early: Sequence[Reading]) -> list[str]:
    """Name readings in use that arrived before their time, and say what to do about them."""
    return [
        f"the reading of {exact_time(reading.time)}, which the table rests on, arrived "
        f"{reading.early_s:.0f} s before its time: a clock is wrong, set it right and withdraw "
        "what is stamped wrongly"
        for reading in early
    ]


def _between(readings: Sequence[Reading]) -> str:
    earliest, latest = exact_time(readings[0].time), exact_time(readings[-1].time)
    return earliest if earliest == latest else f"{earliest} to {latest}"


def _no_reading(context: Context, machine_id: str, window: HeldReadings) -> NoReading:
    if not window.ahead:
        return NoReading(f"machine {machine_id!r} has no reading yet, store one first")
    (warning,) = ahead_warnings(window.ahead, more_ahead=window.more_ahead)
    return NoReading(
        f"machine {machine_id!r} has no reading that can be used yet, at "
        f"{exact_time(context.now())}: {warning}"
    )


def is_stale(state: CurrentState) -> bool:
    """Whether any sensor's value is too old."""
    return any(s.health is Health.STALE for s in state.sensors)


def _seconds(since: datetime, now: datetime) -> float:
    return (now - since).total_seconds()
