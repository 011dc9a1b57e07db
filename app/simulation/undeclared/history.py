"""The machine's true temperatures and its state, minute by minute.

Time is counted in minutes from the first reading. The simulation begins `HIDDEN_DAYS`
earlier, so that neither the bodies nor an effect with a memory begins at rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.signal import lfilter

from app.simulation.undeclared.components import BoolArray, FloatArray
from app.simulation.undeclared.duty_cycle import DAY_MIN, make_duty_cycle, with_spindle_steps
from app.simulation.undeclared.thermal_network import make_network, room_temperature

HIDDEN_DAYS: Final = 2

BODY_OF_SENSOR: Final = {
    "x-middle": "x-middle",
    "y-front": "y-front",
    "z-column": "column-front",
    "spindle": "spindle",
    "bed": "bed",
    "column-rear": "column-rear",
    "ambient": "ambient",
}
"""Where each sensor sits; headstock and table have none."""

SENSORS: Final = tuple(BODY_OF_SENSOR)


@dataclass(frozen=True)
class History:
    """What really was, in each of n minutes.

    Parameters
    ----------
    minutes : ndarray, shape (n,) [min]
        Since the first reading; negative before it.
    temperatures_c : mapping of sensor to ndarray, shape (n,) [°C]
        True temperature where the sensor sits.
    state : mapping of name to ndarray, shape (n,)
        What the control logs.
    working : ndarray, shape (n,)
        Whether the machine is switched on.
    """

    minutes: FloatArray
    temperatures_c: dict[str, FloatArray]
    state: dict[str, FloatArray]
    working: BoolArray

    def at(self, series: FloatArray, time_min: FloatArray) -> FloatArray:
        """Interpolate a series of minutes linearly to times."""
        return np.interp(time_min, self.minutes, series)

    def hold(self, series: FloatArray, time_min: FloatArray) -> FloatArray:
        """Take a series as it stood at the beginning of each time's minute."""
        place = np.floor(np.asarray(time_min) - self.minutes[0]).astype(int)
        values: FloatArray = series[np.clip(place, 0, series.size - 1)]
        return values

    def temperature(self, sensor: str, time_min: FloatArray) -> FloatArray:
        """True temperature of a sensor's place at times [°C]."""
        return self.at(self.temperatures_c[sensor], time_min)

    def since_first_reading(self, series: FloatArray) -> FloatArray:
        """Leave out what was before the first reading."""
        return series[self.minutes >= 0]


def low_pass(series: FloatArray, time_constant_min: float) -> FloatArray:
    """Let a first-order system follow a series that is linear between its minutes.

    Parameters
    ----------
    series : ndarray, shape (n,)
        One value a minute.

    Returns
    -------
    ndarray, shape (n,)
        Exact solution of τ·dy/dt = x − y at the minutes, from rest at the first value.

    Examples
    --------
    >>> low_pass(np.array([0.0, 0.0, 1.0, 1.0]), 1.0).round(4).tolist()
    [0.0, 0.0, 0.3679, 0.7675]
    """
    decay = np.exp(-1.0 / time_constant_min)
    ramp = time_constant_min * (1.0 - decay)
    # After a minute of a ramp from x0 to x1: y1 = kept·y0 + (1 − ramp)·x1 + (ramp − kept)·x0.
    change = lfilter([1.0 - ramp, ramp - decay], [1.0, -decay], series - series[0])
    followed: FloatArray = series[0] + change
    return followed


def make_history(
    rng: np.random.Generator, days: int, steps_min: tuple[int, int] | None = None
) -> History:
    """Simulate a machine in its shop.

    Parameters
    ----------
    days
        Whole days from the first reading, which is taken at a midnight.
    steps_min
        When spindle steps begin, in minutes since the first reading, and how long they take.
    """
    duty = make_duty_cycle(rng, HIDDEN_DAYS + days)
    if steps_min is not None:
        first, lasts = steps_min
        (of_steps,) = rng.spawn(1)
        duty = with_spindle_steps(duty, of_steps, first + HIDDEN_DAYS * DAY_MIN, lasts)
    minutes = np.arange((HIDDEN_DAYS + days) * DAY_MIN, dtype=float)
    air = room_temperature(rng, minutes)
    bodies = make_network(rng).temperatures(air, duty.heat_w()) | {"ambient": air}
    return History(
        minutes - HIDDEN_DAYS * DAY_MIN,
        {sensor: bodies[body] for sensor, body in BODY_OF_SENSOR.items()},
        duty.state,
        duty.working,
    )
