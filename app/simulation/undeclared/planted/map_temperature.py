"""The temperature of one sensor was noted wrongly in one map.

The machine is what it is; the model has that map at the wrong place of its scale. What a believable
slip of the pen cannot do, a thermally more sensitive machine does.
"""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np

from app.simulation.undeclared.components import (
    ASSIGNED_SENSORS,
    COMPONENTS,
    FloatArray,
    following,
)
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.error_tables import ErrorTable
from app.simulation.undeclared.maps import MeasuredMaps
from app.simulation.undeclared.observations import Circumstances, ErrorFunction
from app.simulation.undeclared.planted.sensor_fault import fitted
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("inner", "outermost")

OFF_C: Final = (1.0, 3.0)
LEAST_APART: Final = 0.25
"""Maps come no closer than this share of the gap to their neighbour."""


def plant(setting: Setting, variant: str) -> Effect:
    """Note one map's temperature wrongly, of one of the sensors that components follow."""
    sensor = str(setting.rng.choice(ASSIGNED_SENSORS))
    nodes = setting.machine.map_temperatures_c[sensor]
    inner, outer = list(range(1, nodes.size - 1)), [0, nodes.size - 1]
    row = int(setting.rng.choice(inner if variant == "inner" and inner else outer))
    off_c = float(setting.rng.choice([-1.0, 1.0]) * setting.rng.uniform(*OFF_C))
    noted = nodes.copy()
    beside = row + int(np.sign(off_c))
    if beside in range(nodes.size):
        room_c = (1.0 - LEAST_APART) * abs(nodes[beside] - nodes[row])
        off_c = float(np.sign(off_c) * min(abs(off_c), room_c))
    noted[row] = np.round(nodes[row] + off_c, 1)
    codes = tuple(code for code in following(sensor) if code not in setting.machine.unmeasured)
    effect = Effect(
        "map-temperature",
        variant,
        codes,
        {code: _residual_error(setting.machine.table(code), code, noted) for code in codes},
        sensors=(sensor,),
        parameters={
            "map": f"State {row + 1}",
            "noted_c": float(noted[row]),
            "really_c": float(nodes[row]),
        },
        sensitive=codes,
        maps=partial(_stored, sensor, codes, noted),
    )
    return fitted(setting, effect)


def _stored(
    sensor: str, codes: tuple[str, ...], noted_c: FloatArray, maps: MeasuredMaps
) -> MeasuredMaps:
    tables = {code: maps.tables[code].with_temperatures(noted_c) for code in codes}
    return MeasuredMaps({**maps.tables, **tables}, {**maps.temperatures_c, sensor: noted_c})


def _residual_error(table: ErrorTable, code: str, noted_c: FloatArray) -> ErrorFunction:
    """Make the true error minus what exact maps say on the scale that was noted."""
    component, stored = COMPONENTS[code], table.with_temperatures(noted_c)

    def residual(circumstances: Circumstances) -> FloatArray:
        position = circumstances.point_mm[:, component.axis or 0]
        temperature_c = circumstances.temperature(component.sensor)
        return table.at(position, temperature_c) - stored.at(position, temperature_c, clamp=True)

    return residual
