"""A moment of the record in words that a shop can act on: cold, warm, while warming.

Nobody sets a temperature by itself: a machine is left off overnight, or works for some hours. The
record says for how long it had worked, and how warm it was then.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, floor, hypot
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.errors import list_names
from app.identification.campaign import Campaign
from app.identification.plan.visit import MachineState, StateName
from app.identification.residuals.inexact_sensors import Inexact, inexact_sensors
from app.thermal.coarse_readings import Coarse
from app.thermal.sensor_health import believed
from app.units import SECONDS_PER_H, SECONDS_PER_MIN, date_text

SMALLEST_SET_K: Final = 1.0
"""A difference of temperature that is smaller nobody brings about on purpose [K]."""

SCATTERS: Final = 2.0
"""Nor one below so many times the scatter of the sensors that show it."""

HALF_K: Final = 0.5

COLD: Final = 1.0 / 3.0
"""So much of a sensor's range is cold, and as much is warm."""

MOST_HOURS: Final = 12.0
"""After longer work it does not matter how long it was."""

TIME_CONSTANTS: Final = 3.0
"""After so many time constants 95 % of a change has come."""

USUAL_ROUNDS_MIN: Final = 120.0
EVERY_MIN: Final = 20.0

_OF_THE_SHOP: Final = ("ambient", "room", "air", "hall", "shop")
"""In names of sensors that follow the day, whatever the machine does."""


@dataclass(frozen=True, slots=True, eq=False)
class SensorRange:
    """What one sensor went through.

    Parameters
    ----------
    low_c, high_c
        All but a twentieth of its readings to either side lie between [°C].
    scatter_k
        Scatter of single readings, or the standard deviation within its steps [K].
    """

    times_s: FloatArray
    temperatures_c: FloatArray
    low_c: float
    high_c: float
    scatter_k: float

    @property
    def span_k(self) -> float:
        """How far it goes [K]."""
        return self.high_c - self.low_c

    @property
    def can_be_set(self) -> bool:
        """Whether cold and warm are apart by more than can be set and seen."""
        return self.span_k >= smallest_set_k(self.scatter_k)

    @property
    def step_k(self) -> float:
        """To what its temperatures are rounded [K]."""
        return max(HALF_K, float(ceil(SCATTERS * self.scatter_k)) if self.scatter_k > 0.25 else 0.0)

    def at(self, time_s: float) -> float:
        """Read it at a time [°C]."""
        return float(np.interp(time_s, self.times_s, self.temperatures_c))

    def share(self, time_s: float) -> float:
        """Say where it is in its range: 0 cold, 1 warm."""
        return (self.at(time_s) - self.low_c) / self.span_k

    def rounded(self, temperature_c: float) -> float:
        """Round a temperature to what can be set [°C]."""
        return self.step_k * floor(temperature_c / self.step_k + 0.5)

    def warm_since_s(self, time_s: float) -> float | None:
        """Give for how long it had left the cold third of its range [s]; None: not recorded."""
        is_cold = self.temperatures_c <= self.low_c + COLD * self.span_k
        before = np.flatnonzero(is_cold & (self.times_s <= time_s))
        return None if before.size == 0 else time_s - float(self.times_s[before[-1]])


def smallest_set_k(*scatters_k: float) -> float:
    """Give the smallest difference that a visit can be asked to bring about [K].

    >>> smallest_set_k(0.1), smallest_set_k(0.6, 0.8)
    (1.0, 2.0)
    """
    return max(SMALLEST_SET_K, SCATTERS * hypot(*scatters_k))


def sensor_ranges(campaign: Campaign) -> dict[str, SensorRange]:
    """Look at what each sensor of the record went through."""
    machine = campaign.model.machine
    readings = believed(machine, campaign.readings)
    inexact = inexact_sensors(machine, readings)
    found = {}
    for name in readings.temperatures_c:
        times_s, temperatures_c = readings.series(name)
        if times_s.size > 1:
            low, high = np.percentile(temperatures_c, [5.0, 95.0]).tolist()
            scatter_k = _scatter_k(inexact.get(name))
            found[name] = SensorRange(times_s, temperatures_c, low, high, scatter_k)
    return found


def _scatter_k(one: Inexact | None) -> float:
    if one is None:
        return 0.0
    return one.step_k / 12.0**0.5 if isinstance(one, Coarse) else one.scatter_k


def state_at(
    campaign: Campaign,
    ranges: Mapping[str, SensorRange],
    time_s: float,
    leading: Sequence[str],
    time_constants_min: Sequence[float] = (),
    *,
    is_transient: bool = False,
    shows_all: bool = False,
) -> MachineState:
    """Describe the machine at a moment of the record.

    Parameters
    ----------
    leading
        The sensors and states that matter, most important first.
    time_constants_min
        Those that are in question; none where nobody knows any [min].
    is_transient
        Whether it is to be measured while the first of them changes.
    shows_all
        Whether all of them have to be as they were, and not only those that stand out.
    """
    named = [n for n in leading if n in ranges and (shows_all or ranges[n].can_be_set)]
    if not named or not ranges[named[0]].can_be_set:
        return _without_temperature(campaign, time_s, leading)
    first, main = named[0], ranges[named[0]]
    if not shows_all:
        is_warm = main.share(time_s) > 0.5
        named = [first, *[n for n in named if (ranges[n].share(time_s) > 0.5) != is_warm][:1]]
    name = _state_name(main, time_s, is_transient=is_transient)
    lasts_min = USUAL_ROUNDS_MIN
    if time_constants_min:
        rounds = ceil(TIME_CONSTANTS * max(time_constants_min) / EVERY_MIN)
        lasts_min = max(lasts_min, EVERY_MIN * rounds)
    end_s = time_s + lasts_min * SECONDS_PER_MIN
    states = _states(campaign, time_s, time_s, [n for n in leading if n not in ranges])
    conditions = [
        _conditions(ranges, named, name, time_s, end_s),
        *(f"{n} about {_rounded(x)}" for n, x in states),
    ]
    wait, wait_min = _wait(first, main, name, time_constants_min)
    return MachineState(
        name=name,
        conditions=", ".join(conditions),
        target_c={n: ranges[n].rounded(ranges[n].at(time_s)) for n in named},
        reached=_reached(campaign, first, main, name, time_s, end_s),
        wait=wait,
        wait_min=wait_min,
        rounds=1 + round(lasts_min / EVERY_MIN) if is_transient else 1,
        every_min=EVERY_MIN if is_transient else None,
    )


def _state_name(main: SensorRange, time_s: float, *, is_transient: bool) -> StateName:
    if is_transient:
        is_rising = main.at(time_s + SECONDS_PER_H) > main.at(time_s)
        return "while-warming" if is_rising else "while-cooling"
    share = main.share(time_s)
    return "cold" if share < COLD else "warm" if share > 1.0 - COLD else "part-warm"


def _conditions(
    ranges: Mapping[str, SensorRange],
    named: Sequence[str],
    name: StateName,
    time_s: float,
    end_s: float,
) -> str:
    """Say by which temperatures the state is recognised."""
    first, *others = named
    main = ranges[first]
    begin_c = main.rounded(main.at(time_s))
    if name in ("while-warming", "while-cooling"):
        end_c = main.rounded(main.at(end_s))
        words = f"{first} from about {begin_c:g} °C"
        words += (
            f" to about {end_c:g} °C" if (end_c > begin_c) == (name == "while-warming") else " on"
        )
    elif name == "warm":
        words = f"{first} above {main.step_k * floor(main.at(time_s) / main.step_k):g} °C"
    else:
        words = f"{first} about {begin_c:g} °C"
    besides = (f"{n} about {ranges[n].rounded(ranges[n].at(time_s)):g} °C" for n in others)
    return " while ".join([words, *besides])


def _reached(
    campaign: Campaign,
    sensor: str,
    main: SensorRange,
    name: StateName,
    time_s: float,
    end_s: float,
) -> str:
    if any(word in sensor.lower() for word in _OF_THE_SHOP):
        return f"at the time of day at which the shop was so, as at {date_text(time_s)}"
    if name == "cold":
        return "before the first work of the day, the machine off overnight"
    if name == "while-warming":
        work = _at_work(campaign, time_s, end_s)
        is_cold = main.share(time_s) < COLD
        return ("from the first work of the day on" if is_cold else "when work gets harder") + work
    warm_s = main.warm_since_s(time_s)
    work = _at_work(campaign, time_s - (warm_s or SECONDS_PER_H), time_s)
    hours = 0.0 if warm_s is None else round(2.0 * warm_s / SECONDS_PER_H) / 2.0
    after = "some hours" if warm_s is None or hours > MOST_HOURS else f"about {max(0.5, hours):g} h"
    stop = ", from the moment at which the machine stops" if name == "while-cooling" else ""
    return f"after {after} of work{work}{stop}"


def _at_work(campaign: Campaign, begin_s: float, end_s: float) -> str:
    """Say which states the record has meanwhile, on average; empty where it has none."""
    states = [f"{n} {_rounded(x)}" for n, x in _states(campaign, begin_s, end_s) if x]
    return f" (as recorded then, on average: {list_names(states, 4)})" if states else ""


def _states(
    campaign: Campaign, begin_s: float, end_s: float, names: Sequence[str] | None = None
) -> Iterator[tuple[str, float]]:
    """Give the mean of each state over a time, or what was read last before it."""
    times_s = [time_s for time_s, _ in campaign.state_readings]
    first, last = np.searchsorted(times_s, [begin_s, end_s], side="right").tolist()
    there = [state for _, state in campaign.state_readings[max(first - 1, 0) : last]]
    for name in names if names is not None else dict.fromkeys(n for one in there for n in one):
        values = [one[name] for one in there if name in one]
        if values:
            yield name, float(np.mean(values))


def _rounded(value: float) -> str:
    """Write a state with two digits.

    >>> _rounded(5873.2), _rounded(0.0), _rounded(1.26)
    ('5900', '0', '1.3')
    """
    return f"{float(f'{value:.2g}'):g}"


def _wait(
    sensor: str, main: SensorRange, name: StateName, time_constants_min: Sequence[float]
) -> tuple[str, float | None]:
    """Say how long to wait in a state before the first reading."""
    if name in ("while-warming", "while-cooling"):
        return "do not wait: begin with the change, and measure all points in each round", 0.0
    if name == "cold":
        return "do not wait: overnight everything has settled", 0.0
    if time_constants_min:
        longest = max(time_constants_min)
        wait_min = 10.0 * ceil(TIME_CONSTANTS * longest / 10.0)
        return (
            f"go on so for {wait_min:g} min, three of the time constants in question "
            f"({longest:.2g} min), then measure",
            wait_min,
        )
    still_k = max(HALF_K, main.step_k if main.scatter_k else 0.0)
    return (
        f"how long to wait is not known: measure once {sensor} changes by less than {still_k:g} K "
        "in 20 min",
        None,
    )


def _without_temperature(campaign: Campaign, time_s: float, leading: Sequence[str]) -> MachineState:
    """Describe a moment that no temperature marks: by its states, or as it was."""
    states = [f"{n} {_rounded(x)}" for n, x in _states(campaign, time_s, time_s, leading)]
    return MachineState(
        name="part-warm",
        conditions=list_names(states, 3) if states else "as in the visits before",
        target_c={},
        reached="at any time of usual work",
        wait="do not wait: no temperature is in question",
        wait_min=0.0,
        rounds=1,
        every_min=None,
    )
