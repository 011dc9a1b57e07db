"""What a controller holds against what it should hold now."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.controllers.curve import Curve, Difference, difference
from app.controllers.error_table import ErrorTable, Range
from app.controllers.export import wanted_of
from app.controllers.format import CHECK_FILE, Format, NotHeld, Options, Parsed
from app.errors import InvalidContent
from app.geometry.components import COMPONENTS

BOTH: Final = "both"
MISSING: Final = "missing"
UNKNOWN: Final = "unknown"

UNNAMED: Final = (
    "the files do not say of which machine they are; where thermap wrote them, give "
    f"{CHECK_FILE} with them, which says it"
)
"""Warning where another machine's file would go unseen."""


@dataclass(frozen=True, slots=True)
class Compared:
    """One component: how far what is held is from what should be, held minus wanted.

    `state` is `both`; `missing` where the files lack what they should hold, which counts as 0;
    `unknown` where they hold what the model does not have, which should be 0.
    """

    component: str
    unit: str
    state: str
    difference: Difference


@dataclass(frozen=True, slots=True)
class Comparison:
    """All components, the largest difference first, and what is to be said."""

    components: Sequence[Compared]
    not_held: Sequence[NotHeld]
    warnings: Sequence[str]


def compare(controller: Format, table: ErrorTable, loaded: Parsed, options: Options) -> Comparison:
    """Compare what a controller's files hold with what they should hold.

    Raises
    ------
    InvalidContent
        If the files name another machine, or lie wholly outside the axis' range.
    """
    origin = table.origin
    if loaded.machine is not None and loaded.machine != origin.machine_id:
        raise InvalidContent.of_field(
            "files",
            f"expected files of machine {origin.machine_id!r}, got those of {loaded.machine!r}",
        )
    wanted = wanted_of(controller, table, options)
    compared = []
    for code in COMPONENTS:
        curve, mine = loaded.curves.get(code), wanted.table.curves.get(code)
        if curve is not None:
            _expect_overlap(curve, table)
        if curve is None and mine is None:
            continue
        compared.append(_compared(curve, mine))
    compared.sort(key=lambda item: -abs(item.difference.largest))
    unnamed = [] if loaded.machine else [UNNAMED]
    return Comparison(compared, wanted.not_held, [*table.warnings, *loaded.warnings, *unnamed])


def _compared(loaded: Curve | None, wanted: Curve | None) -> Compared:
    present = wanted if wanted is not None else loaded
    assert present is not None
    nothing = Curve(present.component, present.positions_mm, np.zeros(present.errors.shape))
    state = BOTH if loaded and wanted else MISSING if wanted else UNKNOWN
    off = difference(loaded or nothing, wanted or nothing)
    return Compared(present.code, present.component.unit.symbol, state, off)


def _expect_overlap(curve: Curve, table: ErrorTable) -> None:
    """Refuse a table that lies wholly outside its axis: another machine's, or another unit."""
    range_mm: Range | None = table.ranges_mm.get(str(curve.component.axis))
    if curve.component.axis is None or curve.endless:
        return
    if range_mm is None:
        raise InvalidContent.of_field(
            f"files.{curve.code}", f"expected an axis of the machine, got {curve.component.axis}"
        )
    low, high = float(curve.positions_mm[0]), float(curve.positions_mm[-1])
    touches = high == range_mm[0] or low == range_mm[1]
    if high < range_mm[0] or low > range_mm[1] or (touches and low < high):
        raise InvalidContent.of_field(
            f"files.{curve.code}",
            f"expected positions within the axis' {range_mm[0]:g} to {range_mm[1]:g} mm, got "
            f"{low:g} to {high:g} mm: is this another machine's file, or another unit?",
        )
