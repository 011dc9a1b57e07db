"""What the machine did: spindle, feed, payload and coolant from minute to minute.

Working days begin between half past six and eight and end between four and nine in the
evening; one day in seven the machine rests. A day is a row of blocks of 25 to 120 minutes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from app.simulation.undeclared.components import BoolArray, FloatArray

DAY_MIN: Final = 1440
FASTEST_RPM: Final = 12000.0
FASTEST_FEED_MM_PER_MIN: Final = 15000.0
STEPS_RPM: Final = (0.0, 3000.0, 6000.0, 9000.0, 12000.0)
STEPS_MM_PER_MIN: Final = (0.0, 5000.0, 10000.0, 15000.0)
PAYLOADS_KG: Final = (0.0, 50.0, 100.0, 200.0, 300.0)


@dataclass(frozen=True)
class DutyCycle:
    """What happened in each of n minutes.

    Parameters
    ----------
    state : mapping of name to ndarray, shape (n,)
        What the control logs: `spindle_rpm`, `feed_mm_per_min`, `payload_kg`, `coolant` (0, 1).
    x_share : ndarray, shape (n,)
        Share of the feed that the X axis drives, the rest is Y's; not logged.
    working : ndarray, shape (n,)
        Whether the machine is switched on.
    """

    state: dict[str, FloatArray]
    x_share: FloatArray
    working: BoolArray

    def heat_w(self) -> dict[str, FloatArray]:
        """Heat that the bodies take up through each minute [W]."""
        speed = self.state["spindle_rpm"] / FASTEST_RPM
        feed = self.state["feed_mm_per_min"] / FASTEST_FEED_MM_PER_MIN
        cooled = self.state["coolant"]
        on = self.working.astype(float)
        return {
            "spindle": 480.0 * speed**1.6,
            "x-middle": 200.0 * feed * (0.35 + 0.65 * self.x_share) - 15.0 * cooled,
            "y-front": 200.0 * feed * (1.0 - 0.65 * self.x_share),
            "column-rear": 70.0 * on,
            "bed": 30.0 * on + 30.0 * cooled,
            "table": 40.0 * feed - 40.0 * cooled,
        }


def make_duty_cycle(rng: np.random.Generator, days: int) -> DutyCycle:
    """Draw the duty of whole days, from midnight to midnight.

    Parameters
    ----------
    days
        How many; every seventh, counted from the first Monday, is a day of rest.
    """
    n = days * DAY_MIN
    names = ("spindle_rpm", "feed_mm_per_min", "payload_kg", "coolant")
    state = {name: np.zeros(n) for name in names}
    x_share = np.full(n, 0.5)
    working = np.zeros(n, dtype=bool)
    payload = 0.0
    for day in range(days):
        begins, ends = rng.uniform(6.5, 8.0), rng.uniform(16.0, 21.0)
        if is_day_of_rest(day):
            continue
        minute, until = day * DAY_MIN + int(begins * 60), day * DAY_MIN + int(ends * 60)
        working[minute:until] = True
        while minute < until:
            block = slice(minute, min(minute + int(rng.integers(25, 121)), until))
            payload, logged = _block(rng, payload)
            for name, value in logged.items():
                state[name][block] = value
            x_share[block] = rng.uniform()
            minute = block.stop
        state["payload_kg"][until:] = payload
    return DutyCycle(state, x_share, working)


def with_spindle_steps(
    duty: DutyCycle, rng: np.random.Generator, first_min: int, minutes: int
) -> DutyCycle:
    """Let the machine rest, and then run steps of speed and feed without payload and coolant.

    Parameters
    ----------
    first_min, minutes
        When the steps begin, in minutes of the duty cycle, and how long they take. The machine
        is off from the midnight before.

    Returns
    -------
    DutyCycle
        A tenth of the time for each step, but at least half an hour; none is as the one before.
    """
    state = {name: series.copy() for name, series in duty.state.items()}
    working = duty.working.copy()
    off = slice(first_min - first_min % DAY_MIN, first_min)
    steps = slice(first_min, first_min + minutes)
    for series in state.values():
        series[off] = series[steps] = 0.0
    working[off], working[steps] = False, True
    lasts = max(30, round(minutes / 10))
    speed = feed = -1.0
    for begins in range(steps.start, steps.stop, lasts):
        here = slice(begins, min(begins + lasts, steps.stop))
        speed = float(rng.choice([s for s in STEPS_RPM if s != speed]))
        feed = float(rng.choice([f for f in STEPS_MM_PER_MIN if f != feed]))
        state["spindle_rpm"][here], state["feed_mm_per_min"][here] = speed, feed
    return replace(duty, state=state, working=working)


def is_day_of_rest(day: int) -> bool:
    """Whether the machine rests on a day, counted from a Monday."""
    return day % 7 == 6


def _block(rng: np.random.Generator, payload_kg: float) -> tuple[float, dict[str, float]]:
    """Draw one block: a quarter are pauses of the spindle, an eighth of the feed."""
    if rng.uniform() < 0.45:
        payload_kg = float(rng.choice(PAYLOADS_KG))
    turning = rng.uniform() > 0.25
    moving = rng.uniform() > 0.125
    speed = 500.0 * rng.integers(2, 25)
    feed = round(rng.uniform(0.1, 1.0) * FASTEST_FEED_MM_PER_MIN, -1)
    coolant = rng.uniform() < 0.5
    return payload_kg, {
        "spindle_rpm": speed if turning else 0.0,
        "feed_mm_per_min": feed if moving else 0.0,
        "payload_kg": payload_kg,
        "coolant": float(turning and coolant),
    }
