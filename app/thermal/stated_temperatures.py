"""Hold the temperatures that a map states against those that were recorded at its time.

Two columns of a table that were exchanged pass every other check, and the table is then wrong
between the maps.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Final

FAR_K: Final = 3.0
"""A map takes an hour or so to measure: within that a machine seldom moves by more [K]."""

CLEARLY: Final = 3.0
"""So many times nearer to what was recorded are two temperatures that were exchanged."""

APART_K: Final = 1.0
"""Temperatures that are off by less in all, two of them together, may be so by chance [K]."""


def doubted_temperatures(
    stated_c: Mapping[str, float], recorded_c: Mapping[str, float]
) -> list[str]:
    """Ask about temperatures of a map that are not those that were recorded [°C].

    >>> doubted_temperatures({"bed": 29.0}, {"bed": 24.0, "column": 26.3})[0][:51]
    'readings of its time say bed 24.0 °C, where it stat'
    """
    common = [name for name in stated_c if name in recorded_c]
    found: list[str] = []
    left = list(common)
    for one, other in combinations(common, 2):
        as_stated = _off(stated_c, recorded_c, (one, one), (other, other))
        exchanged = _off(stated_c, recorded_c, (one, other), (other, one))
        is_likely = as_stated > APART_K and as_stated > CLEARLY * exchanged
        if is_likely and one in left and other in left:
            left = [name for name in left if name not in (one, other)]
            found.append(
                f"readings of its time say {one} {recorded_c[one]:.1f} °C, {other} "
                f"{recorded_c[other]:.1f} °C, where it states {stated_c[one]:.1f} and "
                f"{stated_c[other]:.1f} °C: are the two exchanged?"
            )
    found += [
        f"readings of its time say {name} {recorded_c[name]:.1f} °C, where it states "
        f"{stated_c[name]:.1f} °C: is the sensor, the temperature or the time mistaken?"
        for name in left
        if abs(stated_c[name] - recorded_c[name]) > FAR_K
    ]
    return found


def _off(
    stated_c: Mapping[str, float], recorded_c: Mapping[str, float], *pairs: tuple[str, str]
) -> float:
    return sum(abs(stated_c[own] - recorded_c[theirs]) for own, theirs in pairs)
