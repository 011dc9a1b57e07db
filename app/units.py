"""The units of the house and the only factors between them.

Lengths and positions are mm, linear errors µm, angular errors µrad, squareness
µm/m (which is µrad), temperatures °C. A field's name ends in its unit, so this
module also says which unit a field's name promises.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Final

UM_PER_MM: Final = 1000.0
MM_PER_M: Final = 1000.0
URAD_PER_RAD: Final = 1e6
KELVIN_AT_0_C: Final = 273.15


class Unit(StrEnum):
    """The unit of an error component, spelled as in the names of fields."""

    UM = "um"
    URAD = "urad"
    UM_PER_M = "um_per_m"
    URAD_PER_M = "urad_per_m"

    @property
    def symbol(self) -> str:
        """The unit as people write it."""
        return _SYMBOLS[self.value]


_SYMBOLS: Final = {
    "um_per_m": "µm/m",
    "urad_per_m": "µrad/m",
    "c_per_min": "°C/min",
    "um": "µm",
    "urad": "µrad",
    "mm": "mm",
    "c": "°C",
    "s": "s",
    "rpm": "1/min",
}
"""Longest suffix first: `slopes_um_per_m` is not in m."""


def unit_of_field(field: str) -> str | None:
    """Read the unit that a field's name promises, or None where it promises none.

    >>> unit_of_field("positions_mm"), unit_of_field("slopes_um_per_m")
    ('mm', 'µm/m')
    >>> unit_of_field("label") is None
    True
    """
    for suffix, symbol in _SYMBOLS.items():
        if field.endswith("_" + suffix):
            return symbol
    return None


def um_from_urad_mm(product: float) -> float:
    """Convert an angle times a lever arm [µrad·mm] to a displacement [µm].

    The factor serves slopes too: µm/m times mm is the same 1/1000 µm.

    >>> um_from_urad_mm(12.0 * 250.0)
    3.0
    """
    return product / MM_PER_M
