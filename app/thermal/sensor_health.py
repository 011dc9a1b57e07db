"""Whether a sensor can be believed: missing, stale, out of range, stuck, or jumping."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray
from app.errors import FieldError, InvalidContent, UnknownThing
from app.thermal.machine import Machine, Sensor
from app.thermal.temperature_history import TemperatureHistory
from app.units import SECONDS_PER_MIN, duration_text

CLEARLY = 10.0
"""A movement of this many resolutions is one that a sensor must show."""

BEYOND_A_STEP: Final = 1.5
"""Changes of a sensor smaller than this many of its steps are one step."""

WINDOWS = 2.0
"""A record of so many `stuck_after_s` shows a stuck sensor: half of it for the neighbours
to move, half of it for the sensor to follow."""


RECENT: Final = 31
"""Latest readings of a sensor by which it is judged how often it comes."""

FEWEST_INTERVALS: Final = 10

EVEN: Final = 1.5
"""Readings come by the clock if nine in ten intervals are no longer than so many usual ones."""


ONE_WAY: Final = 2.0 / 3.0
"""Of readings that scatter a third goes on in the direction of the one before."""

MISSED: Final = 5.0
"""A sensor is late after so many usual intervals."""

AS_LONG_AGAIN: Final = 2.0
"""It is not late before so many times the longest of its latest intervals."""

LEAST_LATE_S: Final = 15.0
"""It is not late before this age, in which no temperature goes far: networks stall for seconds."""


class Health(StrEnum):
    """What is the matter with a sensor."""

    OK = "ok"
    MISSING = "missing"
    STALE = "stale"
    OUT_OF_RANGE = "out-of-range"
    STUCK = "stuck"
    JUMP = "jump"
    FAULTY = "faulty"


_VERDICTS: Final = (Health.OK, Health.OUT_OF_RANGE, Health.JUMP, Health.STUCK)
"""What a value of a record may be called."""


class SensorState(NamedTuple):
    """A sensor's latest value, its age, and whether it can be believed.

    `detail` is a sentence for a person, empty when all is well. `interval_s` is how far apart its
    readings usually are, and `late_after_s` the age at which one is missed [s]; None where they do
    not come by the clock. `no_value_since` is since when its sender says that it has no value.
    """

    sensor: str
    health: Health
    temperature_c: float | None = None
    age_s: float | None = None
    detail: str = ""
    interval_s: float | None = None
    late_after_s: float | None = None
    no_value_since: datetime | None = None

    @property
    def is_late(self) -> bool:
        """Whether its next reading should have come: it may have stopped, and is not stale yet."""
        return (
            self.health is not Health.STALE
            and self.age_s is not None
            and self.late_after_s is not None
            and self.age_s > self.late_after_s
        )


@dataclass(frozen=True, eq=False)
class JudgedRecord:
    """A machine's latest readings, each value of each sensor judged by what was known at its time.

    All that is made of recorded temperatures is made of `believed`.

    Parameters
    ----------
    verdicts
        Sensor to the place in `_VERDICTS` of each of its known values.
    states
        Each sensor at the time of the latest reading.
    """

    history: TemperatureHistory
    verdicts: Mapping[str, IntArray]
    states: Sequence[SensorState]

    @cached_property
    def believed(self) -> TemperatureHistory:
        """The same times, NaN where a value was out of range, had jumped, or was stuck."""
        return _without(self.history, self.verdicts)

    def are_believed(self, sensor: str) -> BoolArray:
        """Say which of a sensor's known values were believed, shape (n,)."""
        is_ok: BoolArray = self.verdicts[sensor] == _VERDICTS.index(Health.OK)
        return is_ok


def check_temperatures(machine: Machine, temperatures_c: Mapping[str, float]) -> list[SensorState]:
    """Judge temperatures that come without a history.

    Returns
    -------
    list of SensorState
        One for each sensor that has a value: `ok` or `out-of-range`.

    Raises
    ------
    InvalidContent
        If a sensor is unknown, or a value was evidently meant in kelvin: that is
        a mistaken unit, not a broken sensor.
    """
    errors = []
    states = []
    for name, value in temperatures_c.items():
        try:
            sensor = machine.sensor(name)
        except UnknownThing as unknown:
            errors.append(FieldError(f"temperatures_c.{name}", unknown.detail))
            continue
        state = _judge_range(sensor, value)
        if state.detail and sensor.looks_like_kelvin(value):
            errors.append(FieldError(f"temperatures_c.{name}", sensor.expectation(value)))
        states.append(state)
    if errors:
        raise InvalidContent("; ".join(e.message for e in errors), errors)
    return states


def are_in_range(machine: Machine, readings_c: Sequence[Mapping[str, float]]) -> bool:
    """Whether all sensors are known and all temperatures [°C] in their range.

    The short form of `check_temperatures` for the many in which nothing is wrong; shortest where
    each of the readings has the same sensors.
    """
    sensors = machine.sensors
    if not readings_c or not sensors.keys() >= readings_c[0].keys():
        return not readings_c
    # Sensor by sensor: the least and the greatest of many numbers are found in no time.
    for name in readings_c[0]:
        try:
            values = [reading[name] for reading in readings_c]
        except KeyError:
            break
        if not (sensors[name].min_c <= min(values) and max(values) <= sensors[name].max_c):
            return False
    else:
        if all(len(reading) == len(readings_c[0]) for reading in readings_c):
            return True
    return all(are_in_range(machine, [reading]) for reading in readings_c)


def judged_record(machine: Machine, history: TemperatureHistory) -> JudgedRecord:
    """Judge each sensor by its recent readings, and each of these.

    Parameters
    ----------
    history
        Readings back to `record_needed_s` before the latest one.

    Returns
    -------
    JudgedRecord
        With a state for each sensor, its age relative to the latest reading of any sensor.
    """
    verdicts = {name: _verdicts(machine, s, history) for name, s in machine.sensors.items()}
    states = [
        _assess(machine, sensor, history, verdicts[sensor.name])
        for sensor in machine.sensors.values()
    ]
    return JudgedRecord(history, verdicts, states)


def believed(
    machine: Machine, history: TemperatureHistory, sensors: Collection[str] | None = None
) -> TemperatureHistory:
    """Leave out of a record all that was not to be believed at its time.

    Parameters
    ----------
    history
        The record; judgement is sure from `record_needed_s` after its beginning.
    sensors
        Whose record is wanted; of all sensors without it.

    Returns
    -------
    TemperatureHistory
        The same times, NaN where a value was out of range, had jumped, or was stuck.
    """
    wanted = history.temperatures_c.keys() if sensors is None else sensors
    verdicts = {
        name: _verdicts(machine, machine.sensor(name), history)
        for name in history.temperatures_c
        if name in wanted
    }
    return _without(history, verdicts)


def _without(history: TemperatureHistory, verdicts: Mapping[str, IntArray]) -> TemperatureHistory:
    cleaned = {}
    for name, verdict in verdicts.items():
        values = history.temperatures_c[name].copy()
        present = np.flatnonzero(~np.isnan(values))
        values[present[verdict != _VERDICTS.index(Health.OK)]] = np.nan
        cleaned[name] = values
    return TemperatureHistory(history.times_s, cleaned)


def without_stuck(machine: Machine, history: TemperatureHistory) -> TemperatureHistory:
    """Leave out of a record what proved later to have been stuck, since it stood still.

    At its time a value is called stuck only some while after the neighbours moved; who looks
    back knows that it had stopped before, or that it went on by a single step and had not.

    Returns
    -------
    TemperatureHistory
        The same times; of a stretch of equal values that was ever called stuck only the first is
        left, else NaN.
    """
    cleaned = {}
    for name, values in history.temperatures_c.items():
        judged_values = values.copy()
        present = np.flatnonzero(~np.isnan(values))
        verdicts = _verdicts(machine, machine.sensor(name), history)
        stuck = verdicts == _VERDICTS.index(Health.STUCK)
        if stuck.any():
            stretch = np.cumsum(np.append(True, np.diff(values[present]) != 0)) - 1
            first = np.append(True, np.diff(stretch) != 0)
            is_stuck = np.bincount(stretch, weights=stuck) > 0
            ends = np.append(np.flatnonzero(first)[1:] - 1, len(stretch) - 1)
            sensor, times_s = machine.sensor(name), history.times_s[present]
            is_stuck &= [not goes_on(sensor, times_s, values[present], end) for end in ends]
            judged_values[present[is_stuck[stretch] & ~first]] = np.nan
        cleaned[name] = judged_values
    return TemperatureHistory(history.times_s, cleaned)


def goes_on(sensor: Sensor, times_s: FloatArray, values: FloatArray, last: int) -> bool:
    """Whether a sensor that stood still until one of its values went on from there by one step.

    One that had stuck comes back to where its body is by then. A heavy body, read in coarse
    steps, may well show one and the same value while its neighbours move.

    Parameters
    ----------
    times_s, values
        All that is known of it [s, °C].
    last
        Place of the last one of the equal values.
    """
    if last + 1 >= len(values) or times_s[last + 1] - times_s[last] > sensor.max_age_s:
        return False
    change_c = abs(values[last + 1] - values[last])
    # Where it changed this once only, nothing but its resolution says how far one step goes.
    step_c = min(_step_c(sensor, values[: last + 1]), _step_c(sensor, values[last + 1 :]))
    return bool(change_c < BEYOND_A_STEP * step_c)


def record_needed_s(sensors: Iterable[Sensor]) -> float:
    """How far back a record must go for a judgement: to stuck neighbours, to the oldest value [s].

    Zero without sensors.
    """
    return max(
        (max(WINDOWS * (s.stuck_after_s or 0.0), s.max_age_s) for s in sensors),
        default=0.0,
    )


def grow_older(
    machine: Machine, states: Iterable[SensorState], elapsed_s: float
) -> list[SensorState]:
    """Let time pass without readings: ages grow, and what becomes too old is stale [s]."""
    return [_grow_older(machine.sensors[s.sensor], s, elapsed_s) for s in states]


def judge_record(machine: Machine, sensor: Sensor, history: TemperatureHistory) -> list[Health]:
    """Judge each known value of a sensor by what was known at its time.

    Returns
    -------
    list of Health
        (`ok`, `out-of-range`, `jump` or `stuck`) for each of the sensor's
        n known values, in order of time.
    """
    return [_VERDICTS[verdict] for verdict in _verdicts(machine, sensor, history).tolist()]


def _verdicts(machine: Machine, sensor: Sensor, history: TemperatureHistory) -> IntArray:
    """Give for each known value its place in `_VERDICTS`."""
    times, values = history.series(sensor.name)
    if values.size == 0:
        return np.empty(0, dtype=np.intp)
    in_range = _in_range(sensor, values)
    jumped = np.zeros(values.shape, dtype=bool)
    jumped[in_range] = _jumped(sensor, times[in_range], values[in_range])
    stuck = _stuck(machine, sensor, history, times, values)
    return np.select([~in_range, jumped, stuck], [1, 2, 3], default=0).astype(np.intp)


def _grow_older(sensor: Sensor, state: SensorState, elapsed_s: float) -> SensorState:
    if state.age_s is None:
        return state
    age_s = state.age_s + elapsed_s
    if state.health in (Health.OK, Health.STALE) and age_s > sensor.max_age_s:
        detail = (
            f"{sensor.name} is stale: its last value is {duration_text(age_s)} old, at "
            f"most {sensor.max_age_s:g} s are allowed"
        )
        return state._replace(health=Health.STALE, age_s=age_s, detail=detail)
    return state._replace(age_s=age_s)


def _assess(
    machine: Machine, sensor: Sensor, history: TemperatureHistory, judged: IntArray
) -> SensorState:
    times, values = history.series(sensor.name)
    if times.size == 0:
        return SensorState(
            sensor.name,
            Health.MISSING,
            detail=f"{sensor.name} is missing: no reading has it",
        )
    verdicts = [_VERDICTS[verdict] for verdict in judged.tolist()]
    health = verdicts[-1]
    value = float(values[-1])
    detail: str = ""
    if health is Health.OUT_OF_RANGE:
        detail = f"{sensor.name} is out of range: {sensor.expectation(value)}"
    elif health is Health.JUMP:
        trusted = max(
            i for i, v in enumerate(verdicts) if v not in (Health.JUMP, Health.OUT_OF_RANGE)
        )
        detail = (
            f"{sensor.name} jumped from {values[trusted]:g} to {value:g} °C within "
            f"{times[-1] - times[trusted]:.0f} s, expected at most "
            f"{sensor.max_rate_c_per_min:g} °C/min"
        )
        if trusted == 0:
            # Nothing speaks for the first value but that it was the first.
            first_was_wrong = (
                f"if {values[0]:g} °C is what was wrong, withdraw that reading "
                "(`thermap readings withdraw`)"
            )
            detail = "; ".join([detail, first_was_wrong])
    elif health is Health.STUCK:
        first = _runs(sensor, times, values)[0][-1]
        moved = _neighbours_movement(machine, sensor, history, times[first], times[-1:])
        detail = (
            f"{sensor.name} is stuck: exactly {value:g} °C for "
            f"{times[-1] - times[first]:.0f} s while its neighbours moved by "
            f"{moved[0]:.2g} °C"
        )
    age_s = float(history.times_s[-1] - times[-1])
    state = SensorState(sensor.name, health, value, age_s, detail)
    interval_s = usual_interval_s(
        times[-RECENT:], values[-RECENT:], is_sampled=_comes_with_another(sensor, history)
    )
    if interval_s is not None:
        longest_s = float(np.diff(times[-RECENT:]).max())
        late_after_s = max(LEAST_LATE_S, MISSED * interval_s, AS_LONG_AGAIN * longest_s)
        state = state._replace(interval_s=interval_s, late_after_s=late_after_s)
    return _grow_older(sensor, state, 0.0)


def _comes_with_another(sensor: Sensor, history: TemperatureHistory) -> bool:
    """Whether each of a sensor's latest readings has another sensor's value beside it."""
    latest = np.flatnonzero(~np.isnan(history.temperatures_c[sensor.name]))[-RECENT:]
    return any(
        name != sensor.name and not np.isnan(values[latest]).any()
        for name, values in history.temperatures_c.items()
    )


def usual_interval_s(
    times_s: FloatArray, values: FloatArray, *, is_sampled: bool = False
) -> float | None:
    """Say how far apart the latest readings of a sensor are, if they come by the clock [s].

    Who sends on change only is silent when nothing changes. What such a sender sends does not come
    evenly, except where a temperature rises evenly: then no value comes twice, and all of them go
    on in one direction.

    Parameters
    ----------
    times_s, values : ndarray, shape (n,) [s], [°C]
        The latest readings, in order of time.
    is_sampled
        Whether others are always read with it, so that it does not come when it changes.

    Returns
    -------
    float or None
        The median; None where there are too few, they are uneven, or all of them go on in one
        direction.

    Examples
    --------
    >>> usual_interval_s(np.arange(20.0), np.full(20, 25.5))
    1.0
    >>> usual_interval_s(np.arange(20.0), np.arange(20.0)) is None
    True
    """
    intervals = np.diff(times_s)
    if intervals.size < FEWEST_INTERVALS:
        return None
    median, long = np.quantile(intervals, (0.5, 0.9))
    direction = np.sign(np.diff(values))
    goes_on = (direction[1:] == direction[:-1]) & (direction[1:] != 0.0)
    if long > EVEN * median or (not is_sampled and goes_on.mean() > ONE_WAY):
        return None
    return round(float(median), 3)


def _judge_range(sensor: Sensor, value: float) -> SensorState:
    if sensor.min_c <= value <= sensor.max_c:
        return SensorState(sensor.name, Health.OK, value)
    detail = f"{sensor.name} is out of range: {sensor.expectation(value)}"
    return SensorState(sensor.name, Health.OUT_OF_RANGE, value, detail=detail)


def _in_range(sensor: Sensor, values: FloatArray) -> BoolArray:
    return (values >= sensor.min_c) & (values <= sensor.max_c)


def _jumped(sensor: Sensor, times: FloatArray, values: FloatArray) -> BoolArray:
    """Compare each value with the last believed one: heat moves only so fast.

    A value that jumped is not believed until it comes back, or until so much time
    has passed that the change could have been a real one.
    """
    allowance = CLEARLY * sensor.resolution_c
    rate = sensor.max_rate_c_per_min / SECONDS_PER_MIN
    jumped = np.zeros(values.shape, dtype=bool)
    # Where none is too far from the one before, each is believed by that one, and nothing jumped.
    if (np.abs(np.diff(values)) <= rate * np.diff(times) + allowance).all():
        return jumped
    trusted = 0
    for i in range(1, len(values)):
        allowed = rate * (times[i] - times[trusted]) + allowance
        if abs(values[i] - values[trusted]) <= allowed:
            trusted = i
        else:
            jumped[i] = True
    return jumped


def _stuck(
    machine: Machine,
    sensor: Sensor,
    history: TemperatureHistory,
    times: FloatArray,
    values: FloatArray,
) -> BoolArray:
    """Find values that did not change at all though the neighbours moved long enough ago.

    The middle one of the neighbours must have moved clearly since this sensor's last
    change, and `stuck_after_s` must have passed since then: a bed that warms an hour
    after the spindle is not stuck, and rest is no evidence.
    """
    stuck = np.zeros(values.shape, dtype=bool)
    if sensor.stuck_after_s is None:
        return stuck
    step = _step_c(sensor, values)
    starts, ends = _runs(sensor, times, values)
    is_long = times[ends] - times[starts] >= sensor.stuck_after_s
    for first, last in zip(starts[is_long].tolist(), ends[is_long].tolist(), strict=True):
        until = times[first : last + 1] - sensor.stuck_after_s
        moved = _neighbours_movement(machine, sensor, history, times[first], until)
        stuck[first : last + 1] = moved >= CLEARLY * step
    return stuck


def _step_c(sensor: Sensor, values: FloatArray) -> float:
    """Say in what steps a sensor is read [°C]: not smaller than what it resolves."""
    steps = np.abs(np.diff(values))
    return max(sensor.resolution_c, steps[steps > 0].min() if steps.any() else 0.0)


def _runs(sensor: Sensor, times: FloatArray, values: FloatArray) -> tuple[IntArray, IntArray]:
    """Split a record where the value changes or a gap is too wide: first and last of each run."""
    breaks = (np.diff(values) != 0) | (np.diff(times) > sensor.max_age_s)
    starts = np.concatenate([[0], np.flatnonzero(breaks) + 1])
    return starts, np.append(starts[1:] - 1, len(values) - 1)


def _neighbours_movement(
    machine: Machine,
    sensor: Sensor,
    history: TemperatureHistory,
    since_s: float,
    until_s: FloatArray,
) -> FloatArray:
    """Span of the middle neighbour's believable values from a time to each of others [°C]."""
    spans = []
    for other in machine.sensors.values():
        times, values = history.series(other.name)
        counts = (times >= since_s) & _in_range(other, values)
        if other.name != sensor.name and counts.any():
            recent = values[counts]
            so_far = np.maximum.accumulate(recent) - np.minimum.accumulate(recent)
            place = np.searchsorted(times[counts], until_s, side="right") - 1
            spans.append(np.where(place >= 0, so_far[np.maximum(place, 0)], 0.0))
    if not spans:
        return np.zeros(until_s.shape)
    # Of an even number the lower one: of two neighbours both must have moved.
    lower_middle: FloatArray = np.sort(spans, axis=0)[(len(spans) - 1) // 2]
    return lower_middle
