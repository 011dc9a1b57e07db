"""Bending with the difference of two sensors, at once or late.

What is late follows a difference of bodies that no sensor sees; in the thermal states of the maps
they were in balance.
"""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.history import low_pass
from app.simulation.undeclared.planted.additional_sensor import LATE, LATE_MIN
from app.simulation.undeclared.setting import Setting, driven

VARIANTS: Final = ("component",)
ONLY_ASKED_FOR: Final = (LATE,)

PAIRS: Final = (
    ("z-column", "column-rear"),
    ("spindle", "z-column"),
    ("x-middle", "bed"),
    ("bed", "ambient"),
)
"""Across the column, headstock to column, table to bed, bed to room."""


def plant(setting: Setting, variant: str) -> Effect:
    """Bend one component by the difference of two neighbouring bodies."""
    code = setting.choose_component()
    warm, cold = PAIRS[int(setting.rng.integers(len(PAIRS)))]
    profile = setting.choose_profile(code)
    of_maps, of_bodies = setting.machine.map_temperatures_c, setting.history.temperatures_c
    parameters: dict[str, float | str] = {}
    series = of_bodies[warm] - of_bodies[cold]
    if variant == LATE:
        tau = setting.choose_time_constant_min(*LATE_MIN)
        series = low_pass(series, tau)
        parameters["time_constant_min"] = tau
    driver = setting.beyond_maps(
        code,
        lambda circumstances: circumstances.at(series),
        of_maps[warm] - of_maps[cold],
    )
    return setting.scaled(
        Effect(
            "sensor-gradient",
            variant,
            (code,),
            {code: driven(profile, driver)},
            sensors=(warm, cold),
            parameters=parameters,
            strengths=profile.named("_per_k"),
        )
    )
