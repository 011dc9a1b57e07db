"""A second sensor acts too: a component also grows with another sensor's temperature.

At once, or late: then it grows with what a body follows that no sensor sees. In the thermal states
of the maps that body was in balance.
"""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.components import COMPONENTS
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.history import low_pass
from app.simulation.undeclared.setting import Profile, Setting, driven

VARIANTS: Final = ("component",)
EXPANSION: Final = "expansion"
"""A positioning error grows in proportion to the length from the axis' zero, as a scale expands."""

LATE: Final = "late"
ONLY_ASKED_FOR: Final = (EXPANSION, LATE)

LATE_MIN: Final = (20.0, 160.0)
"""Time constants of what is late [min]."""

LENGTHS: Final = ("EXX", "EYY", "EZZ")


def plant(setting: Setting, variant: str) -> Effect:
    """Let one component follow one more sensor."""
    code = setting.choose_component(LENGTHS if variant == EXPANSION else None)
    assigned = COMPONENTS[code].sensor
    second = setting.choose_other_sensor(assigned)
    profile = setting.choose_profile(code)
    if variant == EXPANSION:
        profile = Profile(code, profile.level, profile.level)
    parameters: dict[str, float | str] = {"assigned_sensor": assigned}
    series = setting.history.temperatures_c[second]
    if variant == LATE:
        tau = setting.choose_time_constant_min(*LATE_MIN)
        series = low_pass(series, tau)
        parameters["time_constant_min"] = tau
    driver = setting.beyond_maps(
        code,
        lambda circumstances: circumstances.at(series),
        setting.machine.map_temperatures_c[second],
    )
    return setting.scaled(
        Effect(
            "additional-sensor",
            variant,
            (code,),
            {code: driven(profile, driver)},
            sensors=(second,),
            parameters=parameters,
            strengths=profile.named("_per_k"),
        )
    )
