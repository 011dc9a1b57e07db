"""ISO 230-1 names, units and signs of formats that hold errors as they were measured.

Lengths in mm, angles in rad; squareness under ISO's name and with ISO's sign; rotary-axis
locations with ISO's zero, X0C.
"""

from __future__ import annotations

import re
from typing import Final

from app.geometry.components import COMPONENTS, Component, Kind
from app.units import UM_PER_MM, URAD_PER_RAD, Unit

WRITTEN: Final = tuple(
    code for code, component in COMPONENTS.items() if component.kind is not Kind.SLOPE
)
"""All components but nonrigid slopes."""

DECIMALS: Final = 12
"""Of an error: a millionth of a nanometre, of a microradian."""

POSITION_DECIMALS: Final = 6
"""A nanometre."""


def iso_name(component: Component) -> str:
    """Name a component as ISO 230-1 does.

    >>> iso_name(COMPONENTS["EYX"]), iso_name(COMPONENTS["SXY"]), iso_name(COMPONENTS["XOC"])
    ('EYX', 'C0Y', 'X0C')
    """
    if component.kind is Kind.ROTARY_LOCATION:
        return component.code.replace("O", "0")
    return component.iso or component.code


BY_ISO_NAME: Final = {iso_name(COMPONENTS[code]): COMPONENTS[code] for code in WRITTEN}


def file_factor(component: Component) -> float:
    """The factor from our error to the file's: to mm or rad, and to ISO's sign.

    >>> round(1 / file_factor(COMPONENTS["EXX"])), round(1 / file_factor(COMPONENTS["SXY"]))
    (1000, -1000000)
    """
    per = UM_PER_MM if component.unit is Unit.UM else URAD_PER_RAD
    return component.iso_sign / per


_ROTARY: Final = re.compile(r"E[ABCXYZ][ABCUVW]|[ABCXYZ]0[ABCUVWXYZ]")


def why_not_held(name: str) -> str | None:
    """Say why an error of ISO 230-1 is left aside; None where there is no such error.

    >>> why_not_held("EXC")
    'errors along A, B, C, U, V and W, and locations of other axes, are not held'
    >>> why_not_held("EXQ")
    """
    if not _ROTARY.fullmatch(name):
        return None
    return "errors along A, B, C, U, V and W, and locations of other axes, are not held"
