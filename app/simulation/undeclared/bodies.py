"""Readings and verifications as the service takes them."""

from __future__ import annotations

from typing import Any

import numpy as np

from app.simulation.undeclared.components import AXES, CODES, COMPONENTS, FloatArray
from app.simulation.undeclared.conditions import Conditions
from app.simulation.undeclared.history import History
from app.simulation.undeclared.observations import POINT, Observations
from app.simulation.undeclared.sensors import SensorRecord
from app.simulation.undeclared.truth import Truth

Body = dict[str, Any]


def reading_bodies(record: SensorRecord, history: History, conditions: Conditions) -> list[Body]:
    """Write the readings of every minute.

    Parameters
    ----------
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


def one_verification(truth: Truth, history: History, conditions: Conditions) -> Body:
    """Write all that was measured as one verification.

    Parameters
    ----------
    truth
        With the measured values.
    conditions
        Datum, and what is stated.

    Raises
    ------
    ValueError
        If the visits have zeros of their own.
    """
    if conditions.datum != "absolute" and not conditions.one_verification:
        raise ValueError(
            f"expected values with one zero, got visits each with a {conditions.datum} datum"
        )
    label = "record" if conditions.is_record else "all visits"
    observations = _observation_bodies(truth, history, conditions)
    return {"label": label, **_declaration(conditions), "observations": observations}


def many_verifications(
    truth: Truth, history: History, conditions: Conditions, every_min: float | None = None
) -> list[Body]:
    """Write what was measured as one verification for each visit, or for each stretch of time.

    Parameters
    ----------
    truth
        With the measured values.
    conditions
        Datum, and what is stated.
    every_min
        Length of a stretch from the first observation on [min]; None: a visit, or a block of a
        record.

    Returns
    -------
    list of dict
        The same observations with the same values as in `one_verification`. Where they were
        zeroed once for all, the parts' zeros are said to be `free`.
    """
    observations = _observation_bodies(truth, history, conditions)
    common = _declaration(conditions)
    if conditions.datum != "absolute" and (conditions.one_verification or every_min):
        common["datum"] = "free"
    part = truth.observations.visit
    if every_min:
        time_min = truth.observations.time_min
        part = ((time_min - time_min[0]) // every_min).astype(int)
    name = "part" if every_min else "block" if conditions.is_record else "visit"
    return [
        {
            "label": f"{name} {number + 1:03d}",
            **common,
            "observations": [observations[i] for i in np.flatnonzero(part == number)],
        }
        for number in np.unique(part)
    ]


def prediction_bodies(
    observations: Observations, history: History, conditions: Conditions
) -> list[Body]:
    """Write where and when errors are asked for, as `POST …/predictions` takes it.

    Parameters
    ----------
    conditions
        When the first reading was taken.
    """
    times = _iso(observations.time_min, conditions)
    states = _dicts({n: history.hold(s, observations.time_min) for n, s in history.state.items()})
    points, tools = observations.point_mm.tolist(), observations.tool_mm.tolist()
    directions = observations.direction.tolist()
    bodies = []
    for i, number in enumerate(observations.component.tolist()):
        where: Body
        if number == POINT:
            signs = {axis: _sign(d) for axis, d in zip(AXES, directions[i], strict=True)}
            where = {"point_mm": points[i], "tool_offset_mm": tools[i], "direction": signs}
        else:
            where = _on_line(CODES[number], points[i], directions[i])
        bodies.append({"time": times[i], **where, "state": states[i]})
    return bodies


def _declaration(conditions: Conditions) -> Body:
    repeatability_um = conditions.repeatability_um if conditions.state_repeatability else None
    return {"datum": conditions.datum, "repeatability_um": repeatability_um}


def _observation_bodies(truth: Truth, history: History, conditions: Conditions) -> list[Body]:
    bodies = prediction_bodies(truth.reported, history, conditions)
    # The control's own log: nobody writes it down.
    states = prediction_bodies(truth.observations, history, conditions)
    measured = truth.by_observation(truth.measured_um)
    return [
        body | {"state": really["state"], "measured_um": value}
        for body, really, value in zip(bodies, states, measured, strict=True)
    ]


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
