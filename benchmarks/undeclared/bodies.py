"""Readings and verifications as the service takes them."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.undeclared.components import AXES, CODES, COMPONENTS, FloatArray
from benchmarks.undeclared.conditions import Conditions
from benchmarks.undeclared.history import History
from benchmarks.undeclared.observations import POINT
from benchmarks.undeclared.sensors import SensorRecord
from benchmarks.undeclared.truth import Truth

Body = dict[str, Any]


def reading_bodies(record: SensorRecord, history: History, conditions: Conditions) -> list[Body]:
    """Write the readings of every minute.

    Parameters
    ----------
    record
        What the sensors said.
    history
        The machine's state.
    conditions
        When the first reading was taken.

    Returns
    -------
    list of dict
        `time`, `temperatures_c`, `state`.
    """
    times = _iso(record.minutes, conditions)
    states = _dicts({n: history.since_first_reading(s) for n, s in history.state.items()})
    temperatures = _dicts(record.temperatures_c)
    return [
        {"time": time, "temperatures_c": temperature, "state": state}
        for time, temperature, state in zip(times, temperatures, states, strict=True)
    ]


def verification_bodies(truth: Truth, history: History, conditions: Conditions) -> list[Body]:
    """Write what was measured: a verification for each visit, or one with all.

    Parameters
    ----------
    truth
        With the measured values.
    history
        The machine's state.
    conditions
        Datum, and what is stated.

    Returns
    -------
    list of dict
    """
    observations = _observation_bodies(truth, history, conditions)
    stated = conditions.repeatability_um if conditions.state_repeatability else None
    common = {"datum": conditions.datum, "repeatability_um": stated}
    if conditions.one_verification:
        return [{"label": "all visits", **common, "observations": observations}]
    visits = truth.observations.visit
    return [
        {
            "label": f"visit {visit + 1:03d}",
            **common,
            "observations": [observations[i] for i in np.flatnonzero(visits == visit)],
        }
        for visit in np.unique(visits)
    ]


def _observation_bodies(truth: Truth, history: History, conditions: Conditions) -> list[Body]:
    asked = truth.observations
    times = _iso(asked.time_min, conditions)
    states = _dicts({n: history.held(s, asked.time_min) for n, s in history.state.items()})
    measured = truth.by_observation(truth.measured_um)
    points, tools = asked.point_mm.tolist(), asked.tool_mm.tolist()
    directions = asked.direction.tolist()
    found = []
    for i, number in enumerate(asked.component.tolist()):
        where: Body
        if number == POINT:
            signs = {axis: _sign(d) for axis, d in zip(AXES, directions[i], strict=True)}
            where = {"point_mm": points[i], "tool_offset_mm": tools[i], "direction": signs}
        else:
            where = _on_line(CODES[number], points[i], directions[i])
        found.append({"time": times[i], **where, "measured_um": measured[i], "state": states[i]})
    return found


def _on_line(code: str, point_mm: list[float], direction: list[float]) -> Body:
    axis = COMPONENTS[code].axis
    if axis is None:
        return {"component": code}
    return {
        "component": code,
        "position_mm": point_mm[axis],
        "direction": _sign(direction[axis]),
    }


def _sign(direction: float) -> str:
    return "+" if direction > 0 else "-"


def _iso(minutes: FloatArray, conditions: Conditions) -> list[str]:
    """Write minutes since the first reading as times in UTC, to the second."""
    seconds = np.round(np.asarray(minutes) * 60.0).astype("timedelta64[s]")
    times = np.datetime64(conditions.start, "s") + seconds
    return [f"{time}Z" for time in np.datetime_as_string(times, unit="s")]


def _dicts(series: dict[str, FloatArray]) -> list[dict[str, float]]:
    """Turn series by name into one dict of names for each time."""
    names = list(series)
    columns = [np.asarray(values).tolist() for values in series.values()]
    return [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]
