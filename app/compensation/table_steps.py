"""Steps from one compensation table to another, none larger than a limit.

Tables are compared as the curves that a controller makes of them: straight between positions, the
end value beyond the ends, 0 for a component that is not there. Between two such curves the
largest difference is at a position of one of them, so that the union of both tables' positions is
all that counts, however far apart these are.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Final, TypeAlias

import numpy as np

from app.arrays import FloatArray
from app.compensation.table import ComponentCompensation

SMALLEST_STEP: Final = 0.001
"""Of limits on a step [µm, µrad, µm/m]: ten times what tables are written to, so that each step
gets nearer."""

_ROUNDING: Final = 1e-6
"""Of a number that is written without decimals."""

Curves: TypeAlias = Mapping[str, ComponentCompensation]
"""Component code to its positions and errors."""


def curves_of(components: Iterable[ComponentCompensation], decimals: int) -> Curves:
    """Round tables to what is written of them, without what else is known of their errors."""
    return {
        entry.component.code: replace(
            entry,
            errors=_rounded(entry.errors, decimals),
            backward_errors=None
            if entry.backward_errors is None
            else _rounded(entry.backward_errors, decimals),
            standard_errors=None,
            backward_standard_errors=None,
        )
        for entry in components
    }


def have_same_layout(before: Curves, after: Curves) -> bool:
    """Whether two tables have the same components, positions and directions."""
    return before.keys() == after.keys() and all(
        (entry.backward_errors is None) == (after[code].backward_errors is None)
        and np.array_equal(entry.positions_mm, after[code].positions_mm)
        for code, entry in before.items()
    )


def largest_change(before: Curves, after: Curves) -> float:
    """Give the largest change of an error at any position [its own unit]."""
    return max(
        (
            float(np.abs(_errors(after, code, at_mm, b) - _errors(before, code, at_mm, b)).max())
            for code in {**before, **after}
            for at_mm in (_positions(before, after, code),)
            for b in (False, True)
        ),
        default=0.0,
    )


def step_towards(before: Curves, after: Curves, share: float, decimals: int) -> Curves:
    """Go a share of the way from one table to another, on the positions of both.

    Errors are rounded towards where they came from, so that none goes further than its share. How
    sure a number on the way is, nobody can say: it has no standard error.
    """
    steps = {}
    for code in {**before, **after}:
        at_mm = _positions(before, after, code)
        sides = []
        for is_backward in (False, True):
            start = _errors(before, code, at_mm, is_backward)
            way = share * (_errors(after, code, at_mm, is_backward) - start)
            grid = (start + way) * 10**decimals
            # A number that is on the grid but for its last bits stays: it would else lose a whole
            # step.
            down, up = np.floor(grid + _ROUNDING), np.ceil(grid - _ROUNDING)
            sides.append(np.where(way > 0.0, down, up) / 10**decimals + 0.0)
        entry = after.get(code) or before[code]
        has_backward = any(
            code in table and table[code].backward_errors is not None for table in (before, after)
        )
        steps[code] = replace(
            entry,
            positions_mm=at_mm,
            errors=sides[0],
            backward_errors=sides[1] if has_backward else None,
        )
    return steps


def _positions(before: Curves, after: Curves, code: str) -> FloatArray:
    positions = [table[code].positions_mm for table in (before, after) if code in table]
    return np.unique(np.concatenate(positions))


def _errors(curves: Curves, code: str, positions_mm: FloatArray, is_backward: bool) -> FloatArray:
    """Give a component's errors at positions; 0 for one that is not in the table."""
    entry = curves.get(code)
    if entry is None:
        return np.zeros(max(positions_mm.size, 1))
    return entry.errors_at(positions_mm, is_backward=is_backward)


def _rounded(errors: FloatArray, decimals: int) -> FloatArray:
    # −0 + 0 is 0: no zero is written with a sign.
    return np.round(errors, decimals) + 0.0
