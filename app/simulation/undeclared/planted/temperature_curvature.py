"""Not linear between the maps: the square of the temperature, less what the maps have of it."""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.components import COMPONENTS, FloatArray
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.observations import Circumstances
from app.simulation.undeclared.setting import Setting, driven

VARIANTS: Final = ("component",)


def plant(setting: Setting, variant: str) -> Effect:
    """Bend one component's line over temperature."""
    code = setting.choose_component()
    sensor = COMPONENTS[code].sensor
    nodes = setting.machine.map_temperatures_c[sensor]
    middle = float(nodes[nodes.size // 2])
    profile = setting.choose_profile(code)

    def square(circumstances: Circumstances) -> FloatArray:
        return (circumstances.temperature(sensor) - middle) ** 2

    return setting.scaled(
        Effect(
            "temperature-curvature",
            variant,
            (code,),
            {code: driven(profile, setting.beyond_maps(code, square, (nodes - middle) ** 2))},
            sensors=(sensor,),
            parameters={"about_c": middle},
            strengths=profile.named("_per_k2"),
        )
    )
