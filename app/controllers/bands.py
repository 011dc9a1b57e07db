"""Tables over a range of temperatures, for controllers that cannot ask a service.

Along the way from one thermal state to another the curves change; the way is cut so that from
one band's table to the next no component changes by more than is stated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.controllers.curve import BACKWARD, FORWARD, Curve
from app.errors import InvalidContent

MOST_BANDS: Final = 100
SAMPLES: Final = 400
"""Thermal states along the way at which the change is looked at."""

Temperatures = Mapping[str, float]
Curves = Mapping[str, Curve]


@dataclass(frozen=True, slots=True)
class Band:
    """One band: where it begins and ends, and the temperatures [°C] of its table."""

    from_c: Temperatures
    to_c: Temperatures
    at_c: Temperatures


def temperature_bands(
    curves_at: Callable[[Temperatures], Curves],
    from_c: Temperatures,
    to_c: Temperatures,
    largest_step: float,
) -> list[Band]:
    """Cut the way between two thermal states into bands of equal change.

    Parameters
    ----------
    curves_at
        Gives the curves that a controller should hold at temperatures.
    from_c, to_c
        Sensor to temperature [°C] at both ends; the sensors change together, along a line.
    largest_step
        So much a component may change from one band's table to the next [µm or µrad].

    Returns
    -------
    list of Band
        In order. Each table is that of the middle of its band, counted in change, so that
        inside a band no component is further off than half a step.

    Raises
    ------
    InvalidContent
        If the ends name other sensors, or more than `MOST_BANDS` bands would be needed.
    """
    if set(from_c) != set(to_c) or not from_c:
        raise InvalidContent.of_field(
            "bands.to_c", f"expected the sensors {sorted(from_c)}, got {sorted(to_c)}"
        )
    shares = np.linspace(0.0, 1.0, SAMPLES + 1)
    states = [curves_at(_between(from_c, to_c, float(share))) for share in shares]
    changes = [_change(a, b) for a, b in pairwise(states)]
    way = np.concatenate([[0.0], np.cumsum(changes)])
    number = max(math.ceil(float(way[-1]) / largest_step - 1e-9), 1)
    if number > MOST_BANDS:
        raise InvalidContent.of_field(
            "bands.largest_step_um",
            f"expected a step that needs at most {MOST_BANDS} bands, got {largest_step:g} µm, "
            f"which needs {number} for a change of {way[-1]:.1f} µm along the way",
        )
    at = _shares(way, shares, 2 * number + 1)
    return [
        Band(*(_between(from_c, to_c, float(at[2 * i + j])) for j in (0, 2, 1)))
        for i in range(number)
    ]


def _shares(way: FloatArray, shares: FloatArray, count: int) -> FloatArray:
    """Find where along the way so many equal parts of the change are done."""
    if way[-1] == 0.0:
        return np.linspace(0.0, 1.0, count)
    # Where nothing changes for a while any place serves: interpolation wants increasing numbers.
    rising = way + np.arange(way.size) * way[-1] * 1e-12
    return np.interp(np.linspace(0.0, rising[-1], count), rising, shares)


def _between(from_c: Temperatures, to_c: Temperatures, share: float) -> dict[str, float]:
    return {s: (1.0 - share) * from_c[s] + share * to_c[s] for s in from_c}


def _change(before: Curves, after: Curves) -> float:
    """Find the largest change of any component at any position."""
    largest = 0.0
    for code in {**before, **after}:
        earlier, other = before.get(code), after.get(code)
        curves = [curve for curve in (earlier, other) if curve is not None]
        at = np.unique(np.concatenate([curve.positions_mm for curve in curves]))
        at = at if at.size else np.zeros(1)
        for direction in (FORWARD, BACKWARD):
            values: Sequence[FloatArray] = [
                np.zeros(at.size) if c is None else c.at(at, direction) for c in (earlier, other)
            ]
            largest = max(largest, float(np.abs(values[1] - values[0]).max()))
    return largest
