"""Between which two maps a temperature lies, and where (C. Wang, 8.105–8.107)."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Sequence
from enum import StrEnum
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from app.arrays import BoolArray, FloatArray, IntArray
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
    the upper map `lower + 1`, beyond that range only when extrapolated. `is_limited` says
    that an extrapolation was stopped where it grows too uncertain.
    """

    lower: int
    weight: float
    status: Status
    is_limited: bool = False


class Brackets(NamedTuple):
    """The same of n temperatures, shape (n,) each.

    Where a temperature is not known (NaN) the weight is NaN and the status means nothing.
    `is_refused` says where the policy allows no answer: the weight is then that of the edge of
    what it allows, and the status `clamped`.
    """

    lower: IntArray
    weight: FloatArray
    number: StatusNumbers
    is_refused: BoolArray

    @property
    def status(self) -> StatusArray:
        """Give each one's status: numbers stand for it until somebody asks."""
        return STATUSES[self.number]


StatusArray: TypeAlias = NDArray[np.object_]
"""A status for each of n, as objects."""

StatusNumbers: TypeAlias = NDArray[np.int8]
"""The same as places in `STATUSES`."""

STATUSES: Final[StatusArray] = np.array(list(Status), dtype=object)
NUMBERS: Final = {status: number for number, status in enumerate(Status)}

WeightLimits: TypeAlias = Callable[[int], tuple[float, float]]
"""Gives for the lower of two maps between which weights they may be extrapolated."""


def no_limits(lower: int) -> tuple[float, float]:
    """Extrapolate as far as the margin goes."""
    return -math.inf, math.inf


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
    Bracket(lower=1, weight=0.25, status=<Status.INTERPOLATED: 'interpolated'>, is_limited=False)
    >>> find_bracket([20.0, 24.0, 30.0], 35.0).status
    <Status.CLAMPED: 'clamped'>
    """
    # NaN is below nothing, so that it comes out above the last map, as ∞ does: both are refused
    # before anything is held there.
    upper = bisect_right(map_temperatures_c, temperature_c)
    if 0 < upper < len(map_temperatures_c):
        t_n, t_m = map_temperatures_c[upper - 1], map_temperatures_c[upper]
        if temperature_c == t_n:
            return Bracket(upper - 1, 0.0, Status.AT_MAP)
        weight = (temperature_c - t_n) / (t_m - t_n)
        return Bracket(upper - 1, weight, Status.INTERPOLATED)
    if not math.isfinite(temperature_c):
        raise InvalidContent(f"expected a finite temperature in °C, got {temperature_c:g}")
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
        f"{map_temperatures_c[last]:g} °C, got {temperature_c:g} °C"
    )


def limited(bracket: Bracket, limits: tuple[float, float]) -> Bracket:
    """Stop an extrapolation where it grows too uncertain: further out the value there is held."""
    low, high = limits
    if low <= bracket.weight <= high:
        return bracket
    weight = min(max(bracket.weight, low), high)
    return Bracket(bracket.lower, weight, Status.CLAMPED, is_limited=True)


def find_brackets(
    map_temperatures_c: Sequence[float],
    temperatures_c: FloatArray,
    policy: OutOfRange = OutOfRange.CLAMP,
    margin_c: float = 0.0,
    limits: WeightLimits = no_limits,
) -> Brackets:
    """Find the two maps around each of n temperatures: `find_bracket`, `limited`, all at once.

    Parameters
    ----------
    limits
        Where an extrapolation within the margin is stopped.
    temperatures_c : ndarray, shape (n,) [°C]
        NaN where not known.

    Returns
    -------
    Brackets
        What the policy refuses is held at the edge of what it allows, and marked.

    Examples
    --------
    >>> found = find_brackets([20.0, 24.0, 30.0], np.array([25.5, 35.0]), OutOfRange.REJECT)
    >>> found.lower.tolist(), found.weight.tolist(), found.is_refused.tolist()
    ([1, 1], [0.25, 1.0], [False, True])
    """
    scale = np.asarray(map_temperatures_c, dtype=np.float64)
    t = np.asarray(temperatures_c, dtype=np.float64)
    last = scale.size - 2
    lower = np.clip(np.searchsorted(scale, t, side="right") - 1, 0, last)
    t_n, t_m = scale[lower], scale[lower + 1]
    # Exactly 0 and 1 at the maps: neither 0/x nor x/x is rounded.
    weight = (t - t_n) / (t_m - t_n)
    number = np.full(t.shape, NUMBERS[Status.INTERPOLATED], dtype=np.int8)
    number[(t == t_n) | (t == t_m)] = NUMBERS[Status.AT_MAP]
    is_refused = np.zeros(t.shape, dtype=np.bool_)
    for beyond, pair, end in (
        (np.flatnonzero(t < scale[0]), 0, 0),
        (np.flatnonzero(t > scale[-1]), last, -1),
    ):
        if not beyond.size:
            continue
        wanted = weight[beyond]
        low, high = 0.0, 1.0
        if policy is OutOfRange.EXTRAPOLATE:
            low, high = limits(pair)
            is_refused[beyond] = np.abs(t[beyond] - scale[end]) > margin_c
            margin = margin_c / (scale[pair + 1] - scale[pair])
            weight[beyond] = np.where(
                is_refused[beyond], np.clip(wanted, -margin, 1.0 + margin), wanted
            )
        elif policy is OutOfRange.REJECT:
            is_refused[beyond] = True
        weight[beyond] = np.clip(weight[beyond], low, high)
        goes_on = weight[beyond] == wanted
        number[beyond[goes_on]] = NUMBERS[Status.EXTRAPOLATED]
        number[beyond[~goes_on]] = NUMBERS[Status.CLAMPED]
    return Brackets(lower, weight, number, is_refused)
