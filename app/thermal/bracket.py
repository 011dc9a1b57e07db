"""Between which two maps a temperature lies, and where (C. Wang, 8.105–8.107)."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from enum import StrEnum
from typing import NamedTuple

from app.errors import InvalidContent, OutsideMaps
from app.thermal.machine import OutOfRange


class Status(StrEnum):
    """How a component's error came about."""

    INTERPOLATED = "interpolated"
    AT_MAP = "at-map"
    CLAMPED = "clamped"
    EXTRAPOLATED = "extrapolated"
    STAND_IN = "stand-in"


class Bracket(NamedTuple):
    """The two neighbouring maps of a temperature and the upper one's share.

    `weight` is (T_u − T_n)/(T_m − T_n) of 8.105: 0 at the lower map `lower`, 1 at
    the upper map `lower + 1`, beyond that range only when extrapolated.
    """

    lower: int
    weight: float
    status: Status


def find_bracket(
    map_temperatures_c: Sequence[float],
    temperature_c: float,
    policy: OutOfRange = OutOfRange.CLAMP,
    margin_c: float = 0.0,
) -> Bracket:
    """Find the two maps around a temperature and the weight between them.

    Parameters
    ----------
    map_temperatures_c : sequence of M ≥ 2 floats [°C]
        The maps' temperatures of the assigned sensor, strictly increasing.
    temperature_c
        The live temperature T_u of that sensor [°C].
    policy, margin_c
        What happens outside the maps; how far `extrapolate` may go [°C].

    Returns
    -------
    Bracket

    Raises
    ------
    OutsideMaps
        If the policy is `reject`, or extrapolation would go further than the margin.
    InvalidContent
        If the temperature is not a finite number: it lies nowhere, not at the last map.

    Notes
    -----
    Equations 8.105–8.107; in 8.107 the last term is printed T_w, T_n is right.

    Examples
    --------
    >>> find_bracket([20.0, 24.0, 30.0], 25.5)
    Bracket(lower=1, weight=0.25, status=<Status.INTERPOLATED: 'interpolated'>)
    >>> find_bracket([20.0, 24.0, 30.0], 35.0).status
    <Status.CLAMPED: 'clamped'>
    """
    upper = bisect_right(map_temperatures_c, temperature_c)
    if 0 < upper < len(map_temperatures_c):
        t_n, t_m = map_temperatures_c[upper - 1], map_temperatures_c[upper]
        if temperature_c == t_n:
            return Bracket(upper - 1, 0.0, Status.AT_MAP)
        weight = (temperature_c - t_n) / (t_m - t_n)
        return Bracket(upper - 1, weight, Status.INTERPOLATED)
    if not math.isfinite(temperature_c):
        raise InvalidContent(f"expected a finite temperature in °C, came {temperature_c:g}")
    last = len(map_temperatures_c) - 1
    lower = min(max(upper - 1, 0), last - 1)
    t_n, t_m = map_temperatures_c[lower], map_temperatures_c[lower + 1]
    if temperature_c == t_m:
        return Bracket(lower, 1.0, Status.AT_MAP)
    beyond_c = max(t_n - temperature_c, temperature_c - t_m)
    if policy is OutOfRange.CLAMP:
        return Bracket(lower, 0.0 if temperature_c < t_n else 1.0, Status.CLAMPED)
    if policy is OutOfRange.EXTRAPOLATE and beyond_c <= margin_c:
        return Bracket(lower, (temperature_c - t_n) / (t_m - t_n), Status.EXTRAPOLATED)
    allowed = f"up to {margin_c:g} °C beyond" if policy is OutOfRange.EXTRAPOLATE else "within"
    raise OutsideMaps(
        f"expected a temperature {allowed} the maps' {map_temperatures_c[0]:g} to "
        f"{map_temperatures_c[last]:g} °C, came {temperature_c:g} °C"
    )
