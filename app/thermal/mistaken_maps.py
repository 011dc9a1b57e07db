"""Find components of a map that would fit the machine's other maps if a mistake were undone.

An instrument that states what is to be corrected, or a file of compensations, has every sign
reversed; another begins at the other end of the axis, or counts in thousandths of an inch. Such a
map passes all other checks, and tables beside it then double the error instead of removing it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray, rms
from app.thermal.error_map import ComponentTable, ErrorMap
from app.units import MM_PER_M, Unit

CLEARLY: Final = 3.0
"""So many times further off is a map as it is, or one without errors, than with the mistake
undone."""

LEAST: Final = 2.0
"""What the other maps foretell is at least so large (root mean square, in the component's unit):
less may be noise."""


GROWTH_PER_K: Final = 30.0
"""No part of a machine grows or tilts by more [µm/m, µrad or µm/m, in one kelvin]: aluminium grows
by 24 µm/m."""

SHIFT_PER_K: Final = 5.0
"""Nor does the zero of a length shift by more [µm/K]."""

UNSURE_K: Final = 1.0
"""So much further from each other two maps may have been than their sensors say [K]."""

_OTHER_UNITS: Final = {
    True: (1e3, 25.4, 25.4e3, 25.4e-3),  # mm, mil, in, µin
    False: (1e3, math.radians(1e6)),  # mrad or mm/m, °
}
"""What is taken for µm (True), or for µrad or µm/m, in these. An arcsecond is too near to 1 µrad
for a map to tell."""


class Mistake(NamedTuple):
    """What undoes a mistake: errors so many times as large, or from the axis' other end."""

    factor: float = 1.0
    is_mirrored: bool = False

    def undone(self, table: ComponentTable, positions_mm: FloatArray) -> FloatArray:
        """Give a component's errors as they were meant, at positions of its table."""
        errors = table.errors
        if self.is_mirrored:
            positions_mm = table.positions_mm[0] + table.positions_mm[-1] - positions_mm
        if table.component.is_table:
            errors = np.interp(positions_mm, table.positions_mm, errors)
        return self.factor * errors


REVERSED: Final = Mistake(-1.0)
MIRRORED: Final = Mistake(is_mirrored=True)


def mistakes(
    error_map: ErrorMap, others: Sequence[ErrorMap], assignment: Mapping[str, str]
) -> dict[Mistake, list[str]]:
    """Give the codes of components that a mistake sets apart from the other maps.

    A component is compared with the line through the two other maps that are nearest in the
    temperature of its sensor, around the map's own or on one side of it, and there no further
    away than these two are from each other: an expansion that passes through zero is foretold
    by this line, so that its change of sign is no mistake.

    Where there are no such two, the nearest one alone does not foretell how errors change with
    temperature. Then only what no change of temperature explains is a mistake: a large error of
    nearly the same temperature.

    What explains most components is named first, and the others by what explains them.
    """
    explained: dict[str, list[Mistake]] = {}
    for table, ordered, sensor in _beside(error_map, others, assignment):
        t_c = error_map.temperatures_c[sensor]
        foretold = _along_line(table, ordered, sensor, t_c)
        least = 0.0
        if foretold is None:
            nearest = _nearest(ordered, sensor, t_c)
            foretold = _foretold(table, [(1.0, nearest.tables[table.component.code])])
            least = _most_change(table, _apart_k(error_map, nearest))
        if foretold is None:
            continue
        at_places, expected = foretold
        off = rms(Mistake().undone(table, at_places) - expected)
        if rms(expected) < LEAST or off <= least:
            continue
        left = {m: rms(m.undone(table, at_places) - expected) for m in _mistakes_of(table)}
        clear = [m for m in left if min(off, rms(expected)) > CLEARLY * left[m]]
        units = [m for m in clear if m not in (REVERSED, MIRRORED)]
        if units:
            best = min(units, key=left.__getitem__)
            clear = [m for m in clear if m not in units or m == best]
        if clear:
            explained[table.component.code] = clear
    found: dict[Mistake, list[str]] = {}
    while explained:
        possible = list(dict.fromkeys(m for clear in explained.values() for m in clear))
        first = max(possible, key=lambda m: sum(m in clear for clear in explained.values()))
        found[first] = [code for code, clear in explained.items() if first in clear]
        explained = {code: clear for code, clear in explained.items() if first not in clear}
    return found


def inexplicable(
    error_map: ErrorMap, others: Sequence[ErrorMap], assignment: Mapping[str, str]
) -> dict[str, list[str]]:
    """Give the codes of components that differ from a map by more than its temperatures explain.

    Returns
    -------
    dict of label to list of str
        Of the map that is nearest in the temperature of the component's sensor.
    """
    found: dict[str, list[str]] = {}
    for table, ordered, sensor in _beside(error_map, others, assignment):
        nearest = _nearest(ordered, sensor, error_map.temperatures_c[sensor])
        code = table.component.code
        foretold = _foretold(table, [(1.0, nearest.tables[code])])
        if foretold is None:
            continue
        at_places, expected = foretold
        most = max(_most_change(table, _apart_k(error_map, nearest)), CLEARLY * rms(expected))
        if rms(Mistake().undone(table, at_places) - expected) > most:
            found.setdefault(nearest.label, []).append(code)
    return found


def copied(error_map: ErrorMap, others: Sequence[ErrorMap]) -> str | None:
    """Give the label of another map that has the same errors to the last digit, and not only 0."""
    if not any(table.errors.any() for table in error_map.tables.values()):
        return None
    for other in others:
        if other.tables.keys() == error_map.tables.keys() and all(
            np.array_equal(table.errors, other.tables[code].errors)
            for code, table in error_map.tables.items()
        ):
            return other.label
    return None


def _beside(
    error_map: ErrorMap, others: Sequence[ErrorMap], assignment: Mapping[str, str]
) -> Iterator[tuple[ComponentTable, list[ErrorMap], str]]:
    """Give each component with the maps that have it, in the order of its sensor's temperature."""
    for code, table in error_map.tables.items():
        sensor = assignment.get(code)
        if sensor is None or sensor not in error_map.temperatures_c:
            continue
        having = [o for o in others if code in o.tables and sensor in o.temperatures_c]
        if having:
            yield table, sorted(having, key=lambda o: o.temperatures_c[sensor]), sensor


def _nearest(maps: Sequence[ErrorMap], sensor: str, t_c: float) -> ErrorMap:
    return min(maps, key=lambda candidate: abs(candidate.temperatures_c[sensor] - t_c))


def _mistakes_of(table: ComponentTable) -> Iterator[Mistake]:
    yield REVERSED
    if table.depends_on_position:
        yield MIRRORED
    for factor in _OTHER_UNITS[table.component.unit is Unit.UM]:
        yield Mistake(factor)
        yield Mistake(1.0 / factor)


def _along_line(
    table: ComponentTable, ordered: Sequence[ErrorMap], sensor: str, t_c: float
) -> tuple[FloatArray, FloatArray] | None:
    """Give places of a component, and what two other maps say of them; None if none."""
    if len(ordered) < 2:
        return None
    code = table.component.code
    temperatures_c = [neighbour.temperatures_c[sensor] for neighbour in ordered]
    upper = min(max(int(np.searchsorted(temperatures_c, t_c)), 1), len(ordered) - 1)
    low_c, high_c = temperatures_c[upper - 1], temperatures_c[upper]
    low, high = ordered[upper - 1].tables[code], ordered[upper].tables[code]
    span = high_c - low_c
    if span == 0 or not low_c - span <= t_c <= high_c + span:
        return None
    share = (t_c - low_c) / span
    return _foretold(table, [(1 - share, low), (share, high)])


def _foretold(
    table: ComponentTable, weighted: Sequence[tuple[float, ComponentTable]]
) -> tuple[FloatArray, FloatArray] | None:
    """Give places of a component, and the weighted sum of others there."""
    if not table.component.is_table:
        return table.positions_mm, sum((w * other.errors for w, other in weighted), np.zeros(1))
    inside = np.logical_and.reduce([_inside(table, neighbour) for _, neighbour in weighted])
    if not inside.any():
        return None
    at_places = table.positions_mm[inside]
    expected = sum(
        (
            w * np.interp(at_places, neighbour.positions_mm, neighbour.errors)
            for w, neighbour in weighted
        ),
        np.zeros(at_places.shape),
    )
    return at_places, expected


def _apart_k(first: ErrorMap, other: ErrorMap) -> float:
    """Say by how much two maps' temperatures differ, of whichever sensor the most [K]."""
    common = first.temperatures_c.keys() & other.temperatures_c.keys()
    return max(abs(first.temperatures_c[s] - other.temperatures_c[s]) for s in common) + UNSURE_K


def _most_change(table: ComponentTable, apart_k: float) -> float:
    """Say by how much a difference of temperature may change a component at most [its unit]."""
    if table.component.unit is not Unit.UM:
        return GROWTH_PER_K * apart_k
    reach_m = float(np.ptp(table.positions_mm)) / MM_PER_M if table.component.is_table else 0.0
    return (GROWTH_PER_K * reach_m + SHIFT_PER_K) * apart_k


def _inside(table: ComponentTable, other: ComponentTable) -> BoolArray:
    """Say which positions lie where another table has values; one position holds everywhere."""
    if len(other.positions_mm) == 1:
        return np.ones(len(table.positions_mm), dtype=bool)
    first, last = other.positions_mm[0], other.positions_mm[-1]
    inside: BoolArray = (table.positions_mm >= first) & (table.positions_mm <= last)
    return inside
