"""Temperatures that are stated: in another unit, or not those that were recorded at their time.

Two columns of a table that were exchanged pass every other check, and the table is then wrong
between the maps.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from itertools import combinations, permutations
from typing import Final

from app.units import TemperatureUnit

FAR_K: Final = 3.0
"""A map takes an hour or so to measure: within that a machine seldom moves by more [K]."""

CLEARLY: Final = 3.0
"""So many times nearer to what was recorded are two temperatures that were exchanged."""

APART_K: Final = 1.0
"""Temperatures that are off by less in all, two of them together, may be so by chance [K]."""

WORKSHOP_F: Final = (50.0, 122.0)
"""Between these a machine's temperatures lie in °F [10 to 50 °C]; in °C hardly ever all of them."""


FEWEST_OTHERS: Final = 2
"""Other maps that say which of two sensors is the warmer one: one alone may be the exception."""


def asked_in_fahrenheit(temperatures_c: Collection[float]) -> list[str]:
    """Ask whether all the temperatures of a machine are in °F, where they may be.

    >>> asked_in_fahrenheit([68.0, 77.0])
    ['its temperatures are 68 to 77 °C: are they in °F? Then they are 20.0 to 25.0 °C, and are to \
be stated so']
    """
    low, high = WORKSHOP_F
    if not temperatures_c or not all(low <= t <= high for t in temperatures_c):
        return []
    to_c = TemperatureUnit.FAHRENHEIT.to_c
    coldest, hottest = min(temperatures_c), max(temperatures_c)
    as_written, meant = f"{coldest:g}", f"{to_c(coldest):.1f}"
    if hottest > coldest:
        as_written, meant = f"{as_written} to {hottest:g}", f"{meant} to {to_c(hottest):.1f}"
    return [
        f"its temperatures are {as_written} °C: are they in °F? Then they are {meant} °C, and are "
        "to be stated so"
    ]


def doubted_temperatures(
    stated_c: Mapping[str, float], recorded_c: Mapping[str, float]
) -> list[str]:
    """Ask about temperatures of a map that are not those that were recorded [°C].

    >>> doubted_temperatures({"bed": 29.0}, {"bed": 24.0, "column": 26.3})[0][:51]
    'readings of its time say bed 24.0 °C, where it stat'
    """
    common = [name for name in stated_c if name in recorded_c]
    notes: list[str] = []
    unexplained = list(common)
    for first, other in combinations(common, 2):
        as_stated = _off(stated_c, recorded_c, (first, first), (other, other))
        exchanged = _off(stated_c, recorded_c, (first, other), (other, first))
        is_likely = as_stated > APART_K and as_stated > CLEARLY * exchanged
        if is_likely and first in unexplained and other in unexplained:
            unexplained = [name for name in unexplained if name not in (first, other)]
            notes.append(
                f"readings of its time say {first} {recorded_c[first]:.1f} °C, {other} "
                f"{recorded_c[other]:.1f} °C, where it states {stated_c[first]:.1f} and "
                f"{stated_c[other]:.1f} °C: are the two exchanged?"
            )
    notes += [
        f"readings of its time say {name} {recorded_c[name]:.1f} °C, where it states "
        f"{stated_c[name]:.1f} °C: is the sensor, the temperature or the time mistaken?"
        for name in unexplained
        if abs(stated_c[name] - recorded_c[name]) > FAR_K
    ]
    return notes


def exchanged_temperatures(
    stated_c: Mapping[str, float], others: Sequence[Mapping[str, float]]
) -> list[str]:
    """Ask about two sensors of a map that lie the other way round in all other maps [°C].

    Two other maps at least, in whose range the two would lie if they were exchanged. A machine
    that cools down may look so too: it is a question.

    >>> others = [{"bed": 20.0, "head": 20.5}, {"bed": 22.0, "head": 26.0}]
    >>> exchanged_temperatures({"bed": 24.0, "head": 21.5}, others)[0][:50]
    'head is 2.5 K below bed, where the other maps have'
    """
    if len(others) < FEWEST_OTHERS:
        return []
    found = []
    for lower, upper in permutations(stated_c, 2):
        if not all(lower in other and upper in other for other in others):
            continue
        below_k = stated_c[lower] - stated_c[upper]
        above_k = [other[upper] - other[lower] for other in others]
        least, most = min(above_k), max(above_k)
        off, as_stated = max(least - below_k, below_k - most, 0.0), below_k + least
        if min(below_k, least) > 0.0 and as_stated > max(APART_K, CLEARLY * off):
            found.append((as_stated, lower, upper, below_k, least, most))
    notes = []
    explained: set[str] = set()
    for _, lower, upper, below_k, least, most in sorted(found, reverse=True):
        if not explained & {lower, upper}:
            explained |= {lower, upper}
            notes.append(
                f"{upper} is {below_k:.1f} K below {lower}, where the other maps have it "
                f"{least:.1f} to {most:.1f} K above: are the two exchanged?"
            )
    return notes


def _off(
    stated_c: Mapping[str, float], recorded_c: Mapping[str, float], *pairs: tuple[str, str]
) -> float:
    return sum(abs(stated_c[mine] - recorded_c[theirs]) for mine, theirs in pairs)
