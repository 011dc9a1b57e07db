"""Whether a sensor can be believed: missing, stale, out of range, stuck, or jumping."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import StrEnum
from statistics import median_low
from typing import NamedTuple

import numpy as np

from app.arrays import FloatArray
from app.errors import FieldError, InvalidContent, UnknownThing
from app.thermal.machine import Machine, Sensor
from app.thermal.temperature_history import TemperatureHistory

CLEARLY = 10.0
"""A movement of this many resolutions is one that a sensor must show."""


class Health(StrEnum):
    """What is the matter with a sensor."""

    OK = "ok"
    MISSING = "missing"
    STALE = "stale"
    OUT_OF_RANGE = "out-of-range"
    STUCK = "stuck"
    JUMP = "jump"


class SensorState(NamedTuple):
    """A sensor's latest value, its age, and whether it can be believed.

    `detail` is a sentence for a person, empty when all is well.
    """

    sensor: str
    health: Health
    temperature_c: float | None = None
    age_s: float | None = None
    detail: str = ""


def check_temperatures(machine: Machine, temperatures_c: Mapping[str, float]) -> list[SensorState]:
    """Judge temperatures that come without a history.

    Parameters
    ----------
    machine
        Whose sensors they are.
    temperatures_c
        Sensor to temperature [°C].

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
        state = _judge_range(sensor, value, age_s=None)
        if state.health is not Health.OK and sensor.looks_like_kelvin(value):
            errors.append(FieldError(f"temperatures_c.{name}", sensor.expectation(value)))
        states.append(state)
    if errors:
        raise InvalidContent("; ".join(e.message for e in errors), errors)
    return states


def assess_sensors(machine: Machine, history: TemperatureHistory) -> list[SensorState]:
    """Judge each sensor by its recent readings, at the time of the latest one.

    Parameters
    ----------
    machine
        Whose sensors they are.
    history
        Readings back to at least the longest `stuck_after_s`.

    Returns
    -------
    list of SensorState
        One a sensor, with the age relative to the latest reading of any sensor.
    """
    return [_assess(machine, sensor, history) for sensor in machine.sensors.values()]


def grow_older(
    machine: Machine, states: Iterable[SensorState], elapsed_s: float
) -> list[SensorState]:
    """Let time pass without readings: ages grow, and what becomes too old is stale [s]."""
    return [_grow_older(machine.sensors[s.sensor], s, elapsed_s) for s in states]


def _grow_older(sensor: Sensor, state: SensorState, elapsed_s: float) -> SensorState:
    if state.age_s is None:
        return state
    age_s = state.age_s + elapsed_s
    if state.health is Health.OK and age_s > sensor.max_age_s:
        detail = (
            f"{sensor.name} is stale: its last value is {age_s:.0f} s old, "
            f"at most {sensor.max_age_s:g} s are allowed"
        )
        return SensorState(sensor.name, Health.STALE, state.temperature_c, age_s, detail)
    return SensorState(sensor.name, state.health, state.temperature_c, age_s, state.detail)


def _assess(machine: Machine, sensor: Sensor, history: TemperatureHistory) -> SensorState:
    times, values = history.known(sensor.name)
    if times.size == 0:
        return SensorState(
            sensor.name, Health.MISSING, detail=f"{sensor.name} is missing: no reading has it"
        )
    age_s = float(history.times_s[-1] - times[-1])
    state = _judge_range(sensor, float(values[-1]), age_s)
    if state.health is Health.OK:
        state = _judge_jump(sensor, times, values, state)
    if state.health is Health.OK:
        state = _judge_stuck(machine, sensor, history, times, values, state)
    return _grow_older(sensor, state, 0.0)


def _judge_range(sensor: Sensor, value: float, age_s: float | None) -> SensorState:
    if sensor.accepts(value):
        return SensorState(sensor.name, Health.OK, value, age_s)
    detail = f"{sensor.name} is out of range: {sensor.expectation(value)}"
    return SensorState(sensor.name, Health.OUT_OF_RANGE, value, age_s, detail)


def _judge_jump(
    sensor: Sensor, times: FloatArray, values: FloatArray, state: SensorState
) -> SensorState:
    """Compare with the last believed value: heat moves only so fast.

    A value that jumped is not believed until it comes back, or until so much time
    has passed that the change could have been a real one.
    """
    allowance = CLEARLY * sensor.resolution_c
    rate = sensor.max_rate_c_per_min / 60.0
    believable = [i for i, v in enumerate(values) if sensor.accepts(float(v))]
    trusted = believable[0]
    for i in believable[1:]:
        allowed = rate * (times[i] - times[trusted]) + allowance
        if abs(values[i] - values[trusted]) <= allowed:
            trusted = i
    if trusted == len(values) - 1:
        return state
    detail = (
        f"{sensor.name} jumped from {values[trusted]:g} to {values[-1]:g} °C within "
        f"{times[-1] - times[trusted]:.0f} s, expected at most "
        f"{sensor.max_rate_c_per_min:g} °C/min"
    )
    return SensorState(sensor.name, Health.JUMP, state.temperature_c, state.age_s, detail)


def _judge_stuck(
    machine: Machine,
    sensor: Sensor,
    history: TemperatureHistory,
    times: FloatArray,
    values: FloatArray,
    state: SensorState,
) -> SensorState:
    """Compare with the neighbours: the middle one of them moved, this one did not at all."""
    changed = np.flatnonzero(values != values[-1])
    since_s = times[changed[-1] + 1] if changed.size else times[0]
    unchanged_s = times[-1] - since_s
    if unchanged_s < sensor.stuck_after_s:
        return state
    movements = _movements_since(machine, sensor.name, history, since_s)
    if not movements or median_low(movements) < CLEARLY * sensor.resolution_c:
        return state
    detail = (
        f"{sensor.name} is stuck: exactly {values[-1]:g} °C for {unchanged_s:.0f} s while its "
        f"neighbours moved by {median_low(movements):.2g} °C"
    )
    return SensorState(sensor.name, Health.STUCK, state.temperature_c, state.age_s, detail)


def _movements_since(
    machine: Machine, name: str, history: TemperatureHistory, since_s: float
) -> list[float]:
    """Span of each other sensor's believable temperatures since a time [°C]."""
    spans = []
    for other, sensor in machine.sensors.items():
        times, values = history.known(other)
        believable = (values >= sensor.min_c) & (values <= sensor.max_c)
        recent = values[(times >= since_s) & believable]
        if other != name and recent.size:
            spans.append(float(np.ptp(recent)))
    return spans
