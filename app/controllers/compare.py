"""What a controller holds against what it should hold now."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field

from app.answer import Answer, Code, UnitSymbol
from app.controllers.curve import Curve, difference
from app.controllers.error_table import ErrorTable, Range
from app.controllers.export import wanted_of
from app.controllers.format import CHECK_FILE, Format, NotHeld, Options, Parsed
from app.errors import InvalidContent
from app.geometry.components import COMPONENTS
from app.rounding import Micro

UNNAMED: Final = (
    "the files do not say of which machine they are; where thermap wrote them, give "
    f"{CHECK_FILE} with them, which says it"
)
"""Warning where another machine's file would go unseen."""


@dataclass(frozen=True, slots=True)
class ComparedComponent(Answer, published_as="ComparedComponentAnswer"):
    """How far a component in the files is from what should be there."""

    component: Code
    """ISO 230-1 code"""
    state: Literal["both", "missing", "unknown"]
    """`both`; `missing`: the files lack it, which counts as 0; `unknown`: the files hold it, and
    the model has nothing of it"""
    largest: Annotated[Micro, Field(examples=[-5.0])]
    """Largest difference of the errors: in the files minus as they should be, in `unit`"""
    rms: Micro
    """Root mean square of the difference along the axis, in `unit`"""
    unit: UnitSymbol
    """Unit of both"""
    position_mm: float | None
    """Where it is largest [mm]"""
    direction: str
    """In which direction of approach, `+` or `-`"""


@dataclass(frozen=True, slots=True)
class Comparison:
    """All components, the largest difference first, and what is to be said."""

    components: Sequence[ComparedComponent]
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
    compared.sort(key=lambda item: -abs(item.largest))
    unnamed = [] if loaded.machine else [UNNAMED]
    return Comparison(compared, wanted.not_held, [*table.warnings, *loaded.warnings, *unnamed])


def _compared(loaded: Curve | None, wanted: Curve | None) -> ComparedComponent:
    present = wanted if wanted is not None else loaded
    assert present is not None
    nothing = Curve(present.component, present.positions_mm, np.zeros(present.errors.shape))
    off = difference(loaded or nothing, wanted or nothing)
    return ComparedComponent(
        present.code,
        "both" if loaded and wanted else "missing" if wanted else "unknown",
        off.largest,
        off.rms,
        present.component.unit.symbol,
        off.position_mm,
        off.direction,
    )


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
