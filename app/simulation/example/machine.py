"""The example machine: a simulated vertical machining centre of configuration XYFZ.

It is named after the one of C. Wang, chapter 8, sections 8.2.6–8.2.9, whose
sensors, sensor assignment and ranges of straightness it has. Everything else
about it is invented, and nothing of it was measured on a machine.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from app.arrays import FloatArray, frozen
from app.geometry.chain import Chain
from app.thermal.machine import DEFAULT_STAND_INS, Machine, Sensor, Travel, sensors_by_name

SENSORS: Final = ("spindle", "z-column", "x-middle", "y-front")
"""The four places of the chapter's temperature history (8.2.7)."""

TRAVEL_MM: Final = {"x": 500.0, "y": 500.0, "z": 400.0}
"""Length of each axis' travel from 0 [mm]; the chapter does not give them."""

POSITIONS: Final = 21
"""Positions of every table, evenly spaced over the travel, both ends included."""


def example_machine() -> Machine:
    """Describe the simulated machine of the demonstration.

    Returns
    -------
    Machine
        Chain XYFZ, three linear axes, four sensors; y-front stands in for
        x-middle, "same as the y-front" (8.2.9).

    Examples
    --------
    >>> machine = example_machine()
    >>> machine.name, machine.chain.text
    ('MCFV5050LN (simulated)', 'XYFZ')
    >>> [sensor.name for sensor in machine.with_stand_ins("x-middle")]
    ['x-middle', 'y-front']
    """
    return Machine(
        id="mcfv5050",
        name="MCFV5050LN (simulated)",
        chain=Chain.parse("XYFZ"),
        axes={axis: Travel(0.0, length_mm) for axis, length_mm in TRAVEL_MM.items()},
        sensors=sensors_by_name([_sensor(name) for name in SENSORS]),
    )


def _sensor(name: str) -> Sensor:
    return Sensor(
        name, stand_in=DEFAULT_STAND_INS.get(name), min_c=-10.0, max_c=80.0, max_age_s=120.0
    )


def positions_mm(axis: str) -> FloatArray:
    """List the positions of an axis' error tables.

    Parameters
    ----------
    axis
        `x`, `y` or `z`.

    Returns
    -------
    ndarray, shape (21,) [mm]

    Examples
    --------
    >>> positions_mm("z")[[0, 1, -1]].tolist()
    [0.0, 20.0, 400.0]
    """
    return frozen(np.linspace(0.0, TRAVEL_MM[axis], POSITIONS))
