"""The simulated machine's temperatures: six simulated runs, and a warm-up that never ends.

Simulated after C. Wang, section 8.2.7: temperatures rise from Run #1 to Run #6, most of
all near the spindle. What heated the machine differed between the runs, as in 8.2.6
("various spindle rpm, feed rates"), so that the sensors do not all rise alike (six maps
still leave most of them tied): Run #1 cold; #2 after warming up the spindle; #3 that
heat has gone into the column; #4 after rapid moves of the axes; #5 soon after a step to
high spindle speed; #6 at the end of the day.
"""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.errors import UnknownThing, list_names
from app.simulation.example.machine import SENSORS

_RUN_TEMPERATURES_C: Final = {
    "spindle": (20.8, 25.2, 26.8, 28.6, 33.4, 35.0),
    "z-column": (20.5, 22.1, 24.7, 25.8, 26.2, 28.7),
    "x-middle": (20.3, 20.8, 22.5, 24.6, 25.0, 25.5),
    "y-front": (20.2, 20.8, 22.4, 24.6, 24.9, 25.5),
}
RUNS: Final = (1, 2, 3, 4, 5, 6)
"""Numbers of the runs, cold to hot."""

PERIOD_S: Final = 1200.0
"""Time in which the live demonstration warms up and cools down [s]: hours in 20 minutes, so that no
sensor changes by more than 3 °C/min."""

_LAGS: Final = {
    "spindle": (0.20, 0.05),
    "z-column": (0.20, 0.05, 0.10),
    "x-middle": (0.20, 0.05, 0.10, 0.10),
    "y-front": (0.20, 0.05, 0.10, 0.10, 0.008),
}
"""Time constants of the bodies between the heat and each sensor, as shares of the period."""

_ODD: Final = np.arange(1, 20, 2)
"""Harmonics of heat that is on for one half of the period and off for the other."""

_MARGIN: Final = 0.02
"""Share of the runs' range that the live temperatures leave free at either end."""


def run_temperatures(number: int) -> dict[str, float]:
    """Give the thermal state in which a run was measured.

    Parameters
    ----------
    number
        1 (cold) to 6 (hot).

    Returns
    -------
    dict of sensor to temperature [°C]

    Raises
    ------
    UnknownThing
        If there is no such run.

    Examples
    --------
    >>> run_temperatures(1)
    {'spindle': 20.8, 'z-column': 20.5, 'x-middle': 20.3, 'y-front': 20.2}
    """
    if number not in RUNS:
        raise UnknownThing(
            f"the simulated machine has the runs {list_names(map(str, RUNS))}, got {number}"
        )
    return {sensor: values[number - 1] for sensor, values in _RUN_TEMPERATURES_C.items()}


def temperatures_at(time_s: float) -> dict[str, float]:
    """Give the live temperatures of the demonstration at a time.

    The periodic steady state of a first-order thermal network in closed form: heat
    is on for the first half of each period and passes one body after another, so
    that the column follows the spindle, and the bed follows the column. Each
    sensor is scaled to its range from Run #1 to Run #6, less 2 % at either end.

    Parameters
    ----------
    time_s
        Seconds since 1970-01-01 UTC [s].

    Returns
    -------
    dict of sensor to temperature [°C]
        Rounded to 0.01 °C.

    Examples
    --------
    >>> temperatures_at(300.0) == temperatures_at(300.0 + PERIOD_S)
    True
    >>> temperatures_at(300.0)["spindle"] > temperatures_at(0.0)["spindle"]
    True
    """
    phase = (time_s % PERIOD_S) / PERIOD_S
    return {sensor: round(_live_temperature(sensor, phase), 2) for sensor in SENSORS}


def _live_temperature(sensor: str, phase: float) -> float:
    cold, hot = _RUN_TEMPERATURES_C[sensor][0], _RUN_TEMPERATURES_C[sensor][-1]
    least, greatest = _extremes(sensor)
    wave = float(_response(sensor, np.array([phase]))[0])
    share = (wave - least) / (greatest - least)
    return cold + (hot - cold) * (_MARGIN + (1.0 - 2.0 * _MARGIN) * share)


def _response(sensor: str, phases: FloatArray) -> FloatArray:
    """Pass the heat's Fourier series through a sensor's lags: Im Σ e^{2πinφ}/n Π 1/(1+2πinλ)."""
    turns = 2j * np.pi * _ODD
    passed = 1.0 / _ODD / np.prod([1.0 + turns * lag for lag in _LAGS[sensor]], axis=0)
    series: FloatArray = (np.exp(np.outer(phases, turns)) @ passed).imag
    return series


@cache
def _extremes(sensor: str) -> tuple[float, float]:
    """Least and greatest response over a period."""
    over_period = _response(sensor, np.linspace(0.0, 1.0, 2401))
    return float(over_period.min()), float(over_period.max())
