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

CLEARLY: Final = 3.0
"""So many times further off is a map as it is than with the opposite sign."""

LEAST: Final = 2.0
"""What the other maps foretell is at least so large (root mean square, in the component's unit):
less may be noise."""


def reversed_components(
    error_map: ErrorMap, others: Sequence[ErrorMap], assignment: Mapping[str, str]
) -> list[str]:
    """Give the codes of components whose signs may be reversed.

    A component is compared with the line through the two other maps that are nearest in the
    temperature of its sensor, around the map's own or on one side of it, and there no further
    away than these two are from each other: an expansion that passes through zero is foretold
    by this line, so that its change of sign is no mistake.

    Parameters
    ----------
    assignment
        Component to the sensor that it follows.
    """
    found = []
    for code, table in error_map.tables.items():
        foretold = _foretold(error_map, table, others, assignment.get(code))
        if foretold is None:
            continue
        errors, expected = foretold
        if rms(expected) >= LEAST and rms(errors - expected) > CLEARLY * rms(errors + expected):
            found.append(code)
    return found


def _foretold(
    error_map: ErrorMap, table: ComponentTable, others: Sequence[ErrorMap], sensor: str | None
) -> tuple[FloatArray, FloatArray] | None:
    """Give a component's errors, and what two other maps say of the same places; None if none."""
    code = table.component.code
    if sensor is None or sensor not in error_map.temperatures_c:
        return None
    known = sorted(
        (
            (other.temperatures_c[sensor], other.tables[code])
            for other in others
            if code in other.tables and sensor in other.temperatures_c
        ),
        key=lambda one: one[0],
    )
    if len(known) < 2:
        return None
    t_c = error_map.temperatures_c[sensor]
    above = int(np.searchsorted([t for t, _ in known], t_c))
    upper = min(max(above, 1), len(known) - 1)
    (low_c, low), (high_c, high) = known[upper - 1], known[upper]
    span = high_c - low_c
    if span == 0 or not low_c - span <= t_c <= high_c + span:
        return None
    share = (t_c - low_c) / span
    if not table.component.is_table:
        expected = (1 - share) * low.errors + share * high.errors
        return table.errors, expected
    inside = _inside(table, low) & _inside(table, high)
    if not inside.any():
        return None
    at_low, at_high = (
        np.interp(table.positions_mm[inside], one.positions_mm, one.errors) for one in (low, high)
    )
    return table.errors[inside], (1 - share) * at_low + share * at_high


def _inside(table: ComponentTable, other: ComponentTable) -> BoolArray:
    """Say which positions lie where another table has values; one position holds everywhere."""
    if len(other.positions_mm) == 1:
        return np.ones(len(table.positions_mm), dtype=bool)
    first, last = other.positions_mm[0], other.positions_mm[-1]
    inside: BoolArray = (table.positions_mm >= first) & (table.positions_mm <= last)
    return inside
