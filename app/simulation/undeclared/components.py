"""The 21 errors of a machine with three linear axes, by their ISO 230-1 codes.

Written from the definitions, not from the service: `EYX` is the error in Y as X moves,
`EBX` the rotation about Y as X moves, `SXY` the squareness that adds SXY·y to E_x.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

AXES: Final = "xyz"
MM_PER_M: Final = 1000.0

SENSOR_OF_AXIS: Final = {"x": "x-middle", "y": "x-middle", "z": "z-column"}


@dataclass(frozen=True)
class Component:
    """One error component.

    Parameters
    ----------
    code
        ISO 230-1 code.
    axis
        Number of the axis that is its argument; None for squareness.
    row
        0, 1, 2: a displacement in X, Y, Z; 3, 4, 5: a rotation about X, Y, Z.
    times
        Number of the coordinate that a squareness multiplies, else None.
    """

    code: str
    axis: int | None
    row: int
    sensor: str
    times: int | None = None

    @property
    def is_rotation(self) -> bool:
        """Whether it turns rather than displaces."""
        return self.row > 2

    @property
    def unit(self) -> str:
        """Unit of its values, as field names end: `um`, `urad` or `um_per_m`."""
        if self.axis is None:
            return "um_per_m"
        return "urad" if self.is_rotation else "um"


def _motion_errors() -> list[Component]:
    return [
        Component(f"E{letter}{axis}".upper(), i, row, SENSOR_OF_AXIS[axis])
        for i, axis in enumerate(AXES)
        for row, letter in enumerate("xyzabc")
    ]


def _squareness_errors() -> list[Component]:
    return [
        Component("SXY", None, 0, "x-middle", times=1),
        Component("SYZ", None, 1, "z-column", times=2),
        Component("SZX", None, 0, "z-column", times=2),
    ]


COMPONENTS: Final = {c.code: c for c in [*_motion_errors(), *_squareness_errors()]}
"""All 21 by code."""

CODES: Final = tuple(COMPONENTS)
TRANSLATIONS: Final = tuple(
    c.code for c in COMPONENTS.values() if c.axis is not None and not c.is_rotation
)
ROTATIONS: Final = tuple(c.code for c in COMPONENTS.values() if c.is_rotation)
SQUARENESS: Final = tuple(c.code for c in COMPONENTS.values() if c.axis is None)
ASSIGNED_SENSORS: Final = ("x-middle", "z-column")
"""The sensors that components follow."""


def following(sensor: str) -> tuple[str, ...]:
    """Name the components that follow a sensor."""
    return tuple(code for code, component in COMPONENTS.items() if component.sensor == sensor)
