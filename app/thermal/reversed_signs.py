"""Find components of a map that would fit the machine's other maps with the opposite sign.

An instrument that states what is to be corrected, or a file of compensations, has every sign
reversed. Such a map passes all other checks, and tables beside it then double the error instead
of removing it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from app.arrays import BoolArray, FloatArray, rms
from app.thermal.error_map import ComponentTable, ErrorMap
from app.units import MM_PER_M, Unit

CLEARLY: Final = 3.0
"""So many times further off is a map as it is than with the opposite sign."""

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


def reversed_components(
    error_map: ErrorMap, others: Sequence[ErrorMap], assignment: Mapping[str, str]
) -> list[str]:
    """Give the codes of components whose signs may be reversed.

    A component is compared with the line through the two other maps that are nearest in the
    temperature of its sensor, around the map's own or on one side of it, and there no further
    away than these two are from each other: an expansion that passes through zero is foretold
    by this line, so that its change of sign is no mistake.

    Where there are no such two, the nearest one alone does not foretell how errors change with
    temperature. Then only what no change of temperature explains is a mistake: a large error of
    nearly the same temperature.
    """
    codes = []
    for code, table in error_map.tables.items():
        sensor = assignment.get(code)
        if sensor is None or sensor not in error_map.temperatures_c:
            continue
        having = [o for o in others if code in o.tables and sensor in o.temperatures_c]
        ordered = sorted(having, key=lambda candidate: candidate.temperatures_c[sensor])
        t_c = error_map.temperatures_c[sensor]
        foretold = _along_line(table, ordered, sensor, t_c)
        least = 0.0
        if foretold is None and ordered:
            nearest = min(
                ordered, key=lambda candidate: abs(candidate.temperatures_c[sensor] - t_c)
            )
            foretold = _foretold(table, [(1.0, nearest.tables[table.component.code])])
            least = _most_change(table, _apart_k(error_map, nearest))
        if foretold is None:
            continue
        errors, expected = foretold
        off = rms(errors - expected)
        if rms(expected) >= LEAST and off > max(CLEARLY * rms(errors + expected), least):
            codes.append(code)
    return codes


def _along_line(
    table: ComponentTable, ordered: Sequence[ErrorMap], sensor: str, t_c: float
) -> tuple[FloatArray, FloatArray] | None:
    """Give a component's errors, and what two other maps say of the same places; None if none."""
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
    """Give a component's errors, and the weighted sum of others at the same places."""
    if not table.component.is_table:
        return table.errors, sum((w * neighbour.errors for w, neighbour in weighted), np.zeros(1))
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
    return table.errors[inside], expected


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
