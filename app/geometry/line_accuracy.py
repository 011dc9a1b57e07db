"""Volumetric accuracy from lines along the axes: ELv and ELSv (C. Wang, Table 8.2).

The chapter uses both measures without defining them. These formulas give the printed
values of nine of its ten machines to 0.01 µm; those of machine 8 follow when line III
of x (29.4 µm) is left out of the mean.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Final

from pydantic import Field

from app.answer import Answer, shown
from app.errors import InvalidContent, list_names
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, Kind
from app.rounding import Digits, Micro
from app.stated import Number, Schema

STRAIGHTNESS_CODES: Final = tuple(
    code for code, component in COMPONENTS.items() if component.kind is Kind.STRAIGHTNESS
)


Deviation = Annotated[Number, Field(ge=0)]
Lines = Annotated[list[Deviation], Field(min_length=1, max_length=1000)]


class LinesRequest(
    Schema,
    example={
        "linear_um": {"x": [9.5, 7.2], "y": [15.8, 12.0], "z": [14.3, 25.2]},
        "straightness_um": {
            "EYX": 2.9,
            "EZX": 2.4,
            "EXY": 2.4,
            "EZY": 2.3,
            "EXZ": 15.9,
            "EYZ": 6.1,
        },
    },
):
    """Maximal deviations on lines along the axes."""

    linear_um: dict[str, Lines] = Field(
        description="Axis to the maximal deviation of positioning on each line along it [µm]"
    )
    straightness_um: dict[str, Deviation] = Field(
        description="The maximal deviation of each of the six straightness errors, squareness "
        "included [µm]"
    )


@dataclass(frozen=True, slots=True)
class LineAccuracy(Answer, published_as="LinesAnswer"):
    """Volumetric accuracy from lines (Table 8.2)."""

    elv_um: Annotated[Micro, Field(alias="ELv_um", examples=[25.55])]
    """From displacements alone [µm]"""
    elsv_um: Annotated[Micro, Field(alias="ELSv_um", examples=[42.81])]
    """From displacements and straightness [µm]"""

    @shown
    def ratio(self) -> Annotated[Digits | None, Field(examples=[1.68])]:
        """ELSv/ELv, the chapter's M1; null where ELv is 0."""
        return self.elsv_um / self.elv_um if self.elv_um else None


def line_accuracy(
    linear_um: Mapping[str, Sequence[float]], straightness_um: Mapping[str, float]
) -> LineAccuracy:
    """Compute ELv and ELSv from maximal deviations on lines.

    Parameters
    ----------
    linear_um
        Axis to the maximal deviation of positioning on each line measured along it
        [µm]: I, II, III of Table 8.2.
    straightness_um
        Component code to the maximal deviation of each of the six straightness errors
        [µm]. Table 8.2's contain the squareness errors (8.58–8.60): over its ten
        machines they follow the squareness times the travel.

    Raises
    ------
    InvalidContent
        If an axis has no line, a straightness error is missing or unknown, or a
        deviation is negative or not finite.

    Notes
    -----
    With D̄ the mean over the lines of an axis, ELv = √(D̄x² + D̄y² + D̄z²) and
    ELSv = √((D̄x + Dx(y) + Dx(z))² + (D̄y + Dy(x) + Dy(z))² + (D̄z + Dz(x) + Dz(y))²).

    Examples
    --------
    >>> machine_1 = line_accuracy(
    ...     {"x": [9.5, 7.2], "y": [15.8, 12.0], "z": [14.3, 25.2]},
    ...     {"EYX": 2.9, "EZX": 2.4, "EXY": 2.4, "EZY": 2.3, "EXZ": 15.9, "EYZ": 6.1},
    ... )
    >>> round(machine_1.elv_um, 2), round(machine_1.elsv_um, 2)
    (25.55, 42.81)
    """
    _check(linear_um, straightness_um)
    # ELv  = √(D̄x² + D̄y² + D̄z²), D̄ the mean over the lines I, II, III of Table 8.2
    # ELSv = the same of D̄x + Dx(y) + Dx(z), and so on
    mean = {axis: sum(linear_um[axis]) / len(linear_um[axis]) for axis in LINEAR_LETTERS}
    with_straightness = {
        axis: mean[axis]
        + sum(straightness_um[c] for c in STRAIGHTNESS_CODES if COMPONENTS[c].direction == axis)
        for axis in LINEAR_LETTERS
    }
    return LineAccuracy(math.hypot(*mean.values()), math.hypot(*with_straightness.values()))


def _check(linear_um: Mapping[str, Sequence[float]], straightness_um: Mapping[str, float]) -> None:
    lines = {f"linear_um.{axis}": list(linear_um.get(axis, ())) for axis in LINEAR_LETTERS}
    single = {f"straightness_um.{c}": [straightness_um[c]] for c in straightness_um}
    missing = [code for code in STRAIGHTNESS_CODES if code not in straightness_um]
    unknown = [code for code in straightness_um if code not in STRAIGHTNESS_CODES]
    if missing or unknown:
        raise InvalidContent.of_field(
            "straightness_um",
            f"expected the maximal deviations of {list_names(STRAIGHTNESS_CODES)} in µm, "
            f"got {list_names(straightness_um)}",
        )
    for field, values in (lines | single).items():
        if not values or not all(math.isfinite(value) and value >= 0 for value in values):
            raise InvalidContent.of_field(
                field, f"expected at least one maximal deviation of 0 µm or more, got {values}"
            )
