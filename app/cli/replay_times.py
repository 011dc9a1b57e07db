"""At which times replayed readings are sent, and which times they are given.

A recording sent faster than it was recorded and stamped as it is sent seems to warm up
faster than any machine does, and the service rightly takes that for sensors that jump.
So where that would happen the readings keep their recorded spacing instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from enum import StrEnum

from app.api.schemas.readings import ReadingSchema
from app.cli.csv_recording import Recording
from app.live.reading_window import kept_spacing_s
from app.thermal.machine import Sensor
from app.thermal.sensor_health import CLEARLY
from app.units import SECONDS_PER_MIN
from thermap.answers import SensorSchema


class Stamps(StrEnum):
    """Which times the readings are given."""

    AS_SENT = "stamped as they are sent"
    MOVED = "with their recorded spacing, the last one as it is sent"
    RECORDED = "with their recorded times"


@dataclass(frozen=True, slots=True)
class Plan:
    """What is sent when: seconds after the beginning [s], and the reading."""

    due_s: list[float]
    readings: list[ReadingSchema]
    stamps: Stamps
    reason: str = ""


def plan_replay(
    recording: Recording,
    sensors: Sequence[SensorSchema],
    *,
    now: datetime,
    speed: float,
    start: datetime | None,
    recorded_times: bool,
) -> Plan:
    """Decide when each reading is sent, and with which time.

    Parameters
    ----------
    recording
        What was recorded.
    sensors
        The machine's, with the fastest change that each can have.
    now
        When the replay begins.
    speed
        How many times faster than recorded; 0: all at once.
    start
        When a recording without dates began.
    recorded_times
        Whether readings keep the times of the recording where they could be stamped
        as they are sent.
    """
    zero_s = recording.times_s[0]
    due_s = [(t - zero_s) / speed if speed else 0.0 for t in recording.times_s]
    stamps, reason = _choose_stamps(recording, sensors, speed, start, recorded_times)
    if stamps is Stamps.AS_SENT:
        times = [now + timedelta(seconds=due) for due in due_s]
    else:
        # Sent slower than recorded, all but the first would be in the future.
        end = now + timedelta(seconds=due_s[-1]) if speed >= 1.0 else now
        origin = _origin(recording, stamps, end, start)
        times = [origin + timedelta(seconds=t - zero_s) for t in recording.times_s]
    readings = [
        ReadingSchema(time=time, temperatures_c=dict(values), state={})
        for time, values in zip(times, recording.temperatures_c, strict=True)
    ]
    return Plan(due_s, readings, stamps, reason)


def _choose_stamps(
    recording: Recording,
    sensors: Sequence[SensorSchema],
    speed: float,
    start: datetime | None,
    recorded_times: bool,
) -> tuple[Stamps, str]:
    as_recorded = Stamps.RECORDED if recording.is_dated or start else Stamps.MOVED
    if recorded_times or start or speed == 0.0:
        return as_recorded, ""
    spacing_s = kept_spacing_s(Sensor(**sensor.model_dump()) for sensor in sensors)
    for sensor in sensors:
        if _seems_to_jump(recording, sensor, speed, spacing_s):
            return Stamps.MOVED, (
                f"at {speed:g} times the recorded speed {sensor.name} would seem to jump "
                f"(more than {sensor.max_rate_c_per_min:g} °C/min)"
            )
    return Stamps.AS_SENT, ""


def _origin(
    recording: Recording, stamps: Stamps, end: datetime, start: datetime | None
) -> datetime:
    """Time of the first reading; `end` is when the last one is sent."""
    if stamps is Stamps.MOVED:
        return end - timedelta(seconds=recording.duration_s)
    if recording.is_dated:
        return datetime.fromtimestamp(recording.times_s[0], UTC)
    assert start is not None  # without dates, only a stated start gives recorded times
    return start + timedelta(seconds=recording.times_s[0])


def _seems_to_jump(
    recording: Recording, sensor: SensorSchema, speed: float, spacing_s: float
) -> bool:
    """Whether a sensor's change, so much faster, is more than the service believes.

    Of readings that come closer than `spacing_s` the service keeps only some.
    """
    allowance_c = CLEARLY * sensor.resolution_c
    rate_c_per_s = sensor.max_rate_c_per_min / SECONDS_PER_MIN
    known = [
        (time_s / speed, values[sensor.name])
        for time_s, values in zip(recording.times_s, recording.temperatures_c, strict=True)
        if sensor.name in values
    ]
    kept_s, kept_c = known[0] if known else (0.0, 0.0)
    for time_s, value_c in known:
        if abs(value_c - kept_c) > allowance_c + rate_c_per_s * (time_s - kept_s):
            return True
        if time_s - kept_s >= spacing_s:
            kept_s, kept_c = time_s, value_c
    return False
