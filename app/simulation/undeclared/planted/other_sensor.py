"""A component follows another sensor than the assigned one.

Its error lies between the maps according to the other sensor's temperature. The wanted
amplitude is reached by the component's thermal sensitivity, so that it follows altogether.
"""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.components import COMPONENTS, FloatArray
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.observations import Circumstances
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("component",)


def plant(setting: Setting, variant: str) -> Effect:
    """Let one component follow another sensor."""
    code = setting.choose_component()
    assigned = COMPONENTS[code].sensor
    other = setting.choose_other_sensor(assigned)
    table = setting.machine.table(code)
    by_other = table.with_temperatures(setting.machine.map_temperatures_c[other])
    axis = COMPONENTS[code].axis or 0

    def error(circumstances: Circumstances) -> FloatArray:
        position = circumstances.point_mm[:, axis]
        follows = by_other.at(position, circumstances.temperature(other))
        return follows - table.at(position, circumstances.temperature(assigned))

    return setting.scaled(
        Effect(
            "other-sensor",
            variant,
            (code,),
            {code: error},
            sensors=(other,),
            parameters={"assigned_sensor": assigned},
            sensitive=(code,),
        )
    )
