"""Units that a column's or a comment's name may state, and what they are in ours.

Numbers are converted in decimal, so that 0.0012 mm are 1.2 µm and not 1.2 and a bit.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import Final

from app.cli.delimited_text import plain_heading
from app.errors import list_names
from app.units import MM_PER_M, UM_PER_MM, URAD_PER_RAD, unit_of_field

_SPELLINGS: Final = {"°": " deg", "″": " arcsec", "↑": " forward ", "↓": " backward "}


@dataclass(frozen=True, slots=True)
class Quantity:
    """What is measured, and the units in which people state it.

    Parameters
    ----------
    unit
        Our unit, as the names of fields end in it.
    factors
        Unit as in a plain heading to its size in ours.
    """

    unit: str
    factors: Mapping[str, Decimal]

    def convert(self, value: float, unit: str) -> float:
        """Turn a number in one of the units to ours, rounded once.

        >>> LENGTH.convert(0.0012, "mm"), POSITION.convert(12.5, "mm")
        (1.2, 12.5)
        """
        factor = self.factors[unit]
        return value if factor == 1 else float(Decimal(repr(value)) * factor)


_UM_PER_MM, _MM_PER_M = Decimal(UM_PER_MM), Decimal(MM_PER_M)
_URAD_PER_RAD, _RAD_PER_DEG = Decimal(URAD_PER_RAD), Decimal(math.pi) / 180
_URAD_PER_DEG = _URAD_PER_RAD * _RAD_PER_DEG
_ONE = Decimal(1)

LENGTH: Final = Quantity(
    "um", {"um": _ONE, "micron": _ONE, "mm": _UM_PER_MM, "m": _UM_PER_MM * _MM_PER_M}
)
POSITION: Final = Quantity("mm", {"mm": _ONE, "um": _ONE / _UM_PER_MM, "m": _MM_PER_M})
SMALL_ANGLE: Final = Quantity(
    "urad",
    {
        "urad": _ONE,
        "um_per_m": _ONE,
        "mrad": _URAD_PER_RAD / _MM_PER_M,
        "mm_per_m": _URAD_PER_RAD / _MM_PER_M,
        "rad": _URAD_PER_RAD,
        "arcsec": _URAD_PER_DEG / 3600,
        "arcmin": _URAD_PER_DEG / 60,
        "deg": _URAD_PER_DEG,
    },
)
ANGLE: Final = Quantity("deg", {"deg": _ONE, "rad": _ONE / _RAD_PER_DEG})
TEMPERATURE: Final = Quantity("c", {"c": _ONE, "k": _ONE, "degc": _ONE, "deg_c": _ONE})
"""Differences alone: a kelvin is as large as a degree Celsius."""

EXPANSION: Final = Quantity(
    "um_per_m_k", {"um_per_m_k": _ONE, "um_per_m_per_k": _ONE, "ppm_per_k": _ONE}
)

_ALL_UNITS: Final = {
    unit
    for quantity in (LENGTH, POSITION, SMALL_ANGLE, ANGLE, TEMPERATURE, EXPANSION)
    for unit in quantity.factors
}


@dataclass(frozen=True, slots=True)
class Named:
    """Something that a file states under one of several names.

    Parameters
    ----------
    field
        Our name without the unit.
    quantity
        What it is in; None for words and counts.
    others
        Other plain names of it.
    """

    field: str
    quantity: Quantity | None
    others: tuple[str, ...] = ()

    @property
    def full(self) -> str:
        """Our name with the unit, as the names of fields are."""
        return f"{self.field}_{self.quantity.unit}" if self.quantity else self.field

    def unit_in(self, heading: str) -> str | None:
        """Read the unit from a heading; None where the heading names something else.

        What follows one of the names is returned whether it is a known unit or not;
        a heading that states no unit gives an empty text.

        >>> linear = Named("linear", LENGTH)
        >>> linear.unit_in("Linear [mm]"), linear.unit_in("linear"), linear.unit_in("x_um")
        ('mm', '', None)
        """
        plain = normal_heading(heading)
        for name in sorted((self.field, *self.others), key=len, reverse=True):
            if plain == name:
                return ""
            if plain.startswith(f"{name}_"):
                return plain.removeprefix(f"{name}_")
        return None

    def knows(self, unit: str) -> bool:
        """Say whether a unit is one of ours to convert; words and counts have none."""
        return unit in self.quantity.factors if self.quantity else unit == ""

    def fails_by_unit(self, heading: str) -> bool:
        """Say whether a heading names this, but in no unit or in one that nobody knows.

        `linear_error_of_x_um` is something else; `linear [furlong]` is not.
        """
        unit = self.unit_in(heading)
        if self.quantity is None or unit is None or self.knows(unit):
            return False
        return "_" not in unit or bool(re.search(r"[\[(]", heading)) or unit in _ALL_UNITS

    def complaint(self, unit: str) -> str:
        """Say what was expected in place of a unit that is none."""
        known = list(self.quantity.factors) if self.quantity else []
        came = f"the unit {unit!r}" if unit else "no unit"
        return (
            f"expected the unit of {self.field} in the name, such as {self.full} "
            f"({list_names(known)}), came {came}"
        )


def symbol_of(unit: str) -> str:
    """Write a unit as people do.

    >>> symbol_of("um"), symbol_of("furlong")
    ('µm', 'furlong')
    """
    return unit_of_field(f"_{unit}") or unit


def normal_heading(heading: str) -> str:
    """Write a heading in one way, the signs ° and ″ and arrows as words.

    >>> normal_heading("Angle [°]"), normal_heading("run 1 ↑ [µm]")
    ('angle_deg', 'run_1_forward_um')
    """
    for sign, word in _SPELLINGS.items():
        heading = heading.replace(sign, word)
    return re.sub(r"_+", "_", plain_heading(heading))


def named(things: Iterable[Named], heading: str) -> tuple[Named, str] | None:
    """Find what a heading names, with its known unit."""
    for thing in things:
        unit = thing.unit_in(heading)
        if unit is not None and thing.knows(unit):
            return thing, unit
    return None
