"""The simulated machine's six error maps: its true errors as an instrument reads them.

They stand for the runs of C. Wang, section 8.2.8; nothing was measured.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.geometry.components import COMPONENTS, Component, Kind
from app.simulation.example.machine import positions_mm
from app.simulation.example.true_errors import true_errors
from app.simulation.example.warm_up import run_temperatures
from app.thermal.error_map import ComponentTable, ErrorMap

REPEATABILITY_UM: Final = 0.3
"""Standard deviation of one measured value [µm]."""

ANGULAR_REPEATABILITY_URAD: Final = 0.5
"""Standard deviation of one measured angle [µrad]."""

BASE_M: Final = 0.5
"""Length over which squareness is measured, so that its deviation is 0.6 µm/m [m]."""

_SEED: Final = 8209
_MEASURED_AT: Final = {
    1: datetime(2026, 3, 2, 6, 0, tzinfo=UTC),
    2: datetime(2026, 3, 2, 7, 30, tzinfo=UTC),
    3: datetime(2026, 3, 2, 9, 0, tzinfo=UTC),
    4: datetime(2026, 3, 2, 11, 30, tzinfo=UTC),
    5: datetime(2026, 3, 2, 13, 0, tzinfo=UTC),
    6: datetime(2026, 3, 2, 16, 0, tzinfo=UTC),
}
_DEVIATION: Final[dict[Kind, float]] = {
    Kind.LINEAR: REPEATABILITY_UM,
    Kind.STRAIGHTNESS: REPEATABILITY_UM,
    Kind.ANGULAR: ANGULAR_REPEATABILITY_URAD,
    Kind.SQUARENESS: REPEATABILITY_UM / BASE_M,
}
"""Standard deviation of the noise, in the component's unit."""

_REFERENCE_POINTS: Final[dict[Kind, list[int]]] = {
    Kind.LINEAR: [0],
    Kind.STRAIGHTNESS: [0, -1],
    Kind.ANGULAR: [0],
    Kind.SQUARENESS: [],
}
"""Where a table is zero because its errors count from there."""


def run_map(number: int) -> ErrorMap:
    """Measure the simulated machine in one of its six thermal states.

    Parameters
    ----------
    number
        1 (cold) to 6 (hot).

    Returns
    -------
    ErrorMap
        Labelled `Run #1` to `Run #6`: 9 linear errors [µm] and 9 angular ones [µrad]
        at 21 positions, and 3 squareness errors [µm/m], each with normally distributed
        noise of 0.3 µm (0.5 µrad, 0.6 µm/m), rounded to 0.01. The same number gives
        the same map. It has no measuring lines: its translations are those of the
        axes themselves, free of the rotations' effect.

    Raises
    ------
    UnknownThing
        If there is no such run.

    Examples
    --------
    >>> cold = run_map(1)
    >>> cold.label, cold.instrument, len(cold.tables)
    ('Run #1', 'simulated laser', 21)
    """
    temperatures_c = run_temperatures(number)
    noise = np.random.default_rng([_SEED, number])
    return ErrorMap(
        label=f"Run #{number}",
        measured_at=_MEASURED_AT[number],
        temperatures_c=temperatures_c,
        tables={
            code: _measured_table(COMPONENTS[code], errors, noise)
            for code, errors in true_errors(temperatures_c).items()
        },
        repeatability_um=REPEATABILITY_UM,
        instrument="simulated laser",
    )


def _measured_table(
    component: Component, errors: FloatArray, noise: np.random.Generator
) -> ComponentTable:
    """Read a table of true errors with noise, except where it counts from."""
    deviations = noise.normal(0.0, _DEVIATION[component.kind], errors.size)
    deviations[_REFERENCE_POINTS[component.kind]] = 0.0
    positions = positions_mm(component.axis) if component.axis else ()
    return ComponentTable.make(component, np.round(errors + deviations, 2), positions)
