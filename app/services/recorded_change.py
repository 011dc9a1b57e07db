"""By how much tables would have changed at what was recorded, not only at the latest reading.

The latest reading mostly lies where maps differ little: at one of them, or in the morning. A map
whose temperatures were swapped shows where the machine was warm.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Annotated, Final

import numpy as np
from pydantic import Field
from sqlalchemy.orm import Session

from app.answer import Answer, fields_of
from app.compensation.table_difference import ComponentChange, component_changes
from app.errors import ThermapError
from app.live.registry import LiveModel
from app.services.live_table import table_at
from app.storage.readings import newest_readings, newest_time, oldest_time
from app.thermal.machine import Machine
from app.thermal.reading import Reading
from app.thermal.sensor_health import Health, grow_older, judged_record
from app.thermal.temperature_history import TemperatureHistory

LOOKED_AT: Final = 150
"""Moments from the last reading back to the first, evenly in time, among which some are chosen."""

MOMENT: Final = timedelta(microseconds=1)
"""So much before a reading lies the next one at least."""

COMPARED: Final = 24
"""So many of them, as far apart in temperature as can be: each costs two tables."""

CLEARLY: Final = 1.2
"""So many times larger is another change than that at the latest reading."""

LEAST: Final = 0.005
"""Less than this is written as nothing [the component's unit]."""

AROUND: Final = 30
"""Readings that are put together for a moment: not every one has all sensors, and a value is judged
by those before it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangeThen(ComponentChange, published_as="ChangeThenAnswer", whole=False):
    """The largest change of one component's error over what was recorded, and when that was."""

    time: datetime
    """Time of that reading, UTC"""
    temperatures_c: Mapping[str, float]
    """The temperatures then [°C]"""


@dataclass(frozen=True, slots=True)
class RecordedChanges(Answer, published_as="RecordedChangesAnswer", whole=False):
    """By how much tables would have differed at what was recorded, up to the latest reading."""

    count: Annotated[int, Field(examples=[24])]
    """At how many recorded moments tables were compared: a few dozen of them, as far apart in
    temperature as can be; 0 where there are none"""
    changes: Sequence[ChangeThen]
    """The largest change over them of each component that changes more there than at the latest
    reading, the largest number first (1 µrad counts as 1 µm); what adopted effects make of the past
    (lags) is not in it"""
    first_at: datetime | None = None
    """The first of the moments, UTC; null without any"""
    last_at: datetime | None = None
    """The last of them, UTC; null without any"""


def recorded_changes(
    session: Session,
    before: LiveModel,
    after: LiveModel,
    until: datetime,
    now: Sequence[ComponentChange] = (),
) -> RecordedChanges:
    """Compare the tables of two models at a spread of what was recorded up to a time.

    `now` are the changes at the latest reading. What effects make of the past (lags) is in neither
    table, for one moment does not say it.
    """
    machine = after.model.machine
    used = sorted({g.sensor for live_model in (before, after) for g in live_model.model.groups})
    largest: dict[str, ChangeThen] = {}
    times = []
    for moment in _spread(list(_moments(session, machine, until)), used):
        try:
            tables = [
                table_at(live_model, moment.temperatures_c, moment.time, state=moment.state)
                for live_model in (before, after)
            ]
        except ThermapError:
            continue  # a sensor was missing then, or the machine's policy has no table there
        times.append(moment.time)
        for change in component_changes(*tables):
            code = change.component
            if code not in largest or abs(change.change) > abs(largest[code].change):
                largest[code] = ChangeThen(
                    **fields_of(change), time=moment.time, temperatures_c=moment.temperatures_c
                )
    if not times:
        return RecordedChanges(0, ())
    least = {
        change_now.component: max(CLEARLY * abs(change_now.change), LEAST) for change_now in now
    }
    further = [
        further_change
        for code, further_change in largest.items()
        if abs(further_change.change) >= least.get(code, LEAST)
    ]
    ordered = sorted(further, key=lambda component_change: -abs(component_change.change))
    return RecordedChanges(len(times), ordered, min(times), max(times))


def temperatures_then(session: Session, machine: Machine, time: datetime) -> dict[str, float]:
    """Give what sensors said at a time, as far as their values were not too old [°C]."""
    return _temperatures(machine, newest_readings(session, machine.id, time, AROUND), time)


def _moments(session: Session, machine: Machine, until: datetime) -> Iterator[Reading]:
    """Read what was recorded at moments from the last reading back to the first, each once."""
    first, last = oldest_time(session, machine.id), newest_time(session, machine.id, until)
    if first is None or last is None or last < first:
        return
    at = last
    for remaining in range(LOOKED_AT, 0, -1):
        readings = newest_readings(session, machine.id, at, AROUND)
        if not readings:
            return
        time = readings[-1].time
        yield Reading(time, _temperatures(machine, readings, time), readings[-1].state)
        # What is left is divided anew each time: a gap in the record takes one moment only.
        at = time - max((time - first) / remaining, MOMENT)


def _temperatures(
    machine: Machine, readings: Sequence[Reading], time: datetime
) -> dict[str, float]:
    """Put readings together, in order of time: each sensor's last value.

    Without those that are too old by then, or were not to be believed.
    """
    if not readings:
        return {}
    history = TemperatureHistory.of_readings(
        machine.sensors, [(r.time.timestamp(), r.temperatures_c) for r in readings]
    )
    record = judged_record(machine, history)
    return {
        s.sensor: s.temperature_c
        for s in grow_older(machine, record.states, time.timestamp() - history.times_s[-1])
        if s.health is Health.OK and s.temperature_c is not None
    }


def _spread(moments: Sequence[Reading], sensors: Sequence[str]) -> list[Reading]:
    """Choose moments that are far apart in temperature, the latest first."""
    if len(moments) <= COMPARED or not sensors:
        return list(moments[:COMPARED])
    values = np.array([[m.temperatures_c.get(s, np.nan) for s in sensors] for m in moments])
    with_all = np.flatnonzero(~np.isnan(values).any(axis=1))
    if with_all.size == 0:
        return list(moments[:COMPARED])
    values = values[with_all]
    chosen = [0]
    away = np.linalg.norm(values - values[0], axis=1)
    while len(chosen) < COMPARED and away.max() > 0.0:
        chosen.append(int(away.argmax()))
        away = np.minimum(away, np.linalg.norm(values - values[chosen[-1]], axis=1))
    return [moments[i] for i in with_all[chosen].tolist()]
