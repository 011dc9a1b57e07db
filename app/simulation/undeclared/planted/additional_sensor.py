"""A second sensor acts too: a component also grows with another sensor's temperature."""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.components import COMPONENTS
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.setting import Profile, Setting, driven

VARIANTS: Final = ("component",)
EXPANSION: Final = "expansion"
ONLY_ASKED_FOR: Final = (EXPANSION,)
"""A positioning error grows in proportion to the length from the axis' zero, as a scale expands."""

LENGTHS: Final = ("EXX", "EYY", "EZZ")


def plant(setting: Setting, variant: str) -> Effect:
    """Let one component follow one more sensor."""
    code = setting.choose_component(LENGTHS if variant == EXPANSION else None)
    assigned = COMPONENTS[code].sensor
    second = setting.choose_other_sensor(assigned)
    profile = setting.choose_profile(code)
    if variant == EXPANSION:
        profile = Profile(code, profile.level, profile.level)
    driver = setting.beyond_maps(
        code,
        lambda circumstances: circumstances.temperature(second),
        setting.machine.map_temperatures_c[second],
    )
    return setting.scaled(
        Effect(
            "additional-sensor",
            variant,
            (code,),
            {code: driven(profile, driver)},
            sensors=(second,),
            parameters={"assigned_sensor": assigned},
            strengths=profile.named("_per_k"),
        )
    )
