"""Bending with the difference of two sensors."""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.setting import Setting, driven

VARIANTS: Final = ("component",)

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
    of_maps = setting.machine.map_temperatures_c
    driver = setting.beyond_maps(
        code,
        lambda circumstances: circumstances.temperature(warm) - circumstances.temperature(cold),
        of_maps[warm] - of_maps[cold],
    )
    return setting.scaled(
        Effect(
            "sensor-gradient",
            variant,
            (code,),
            {code: driven(profile, driver)},
            sensors=(warm, cold),
            strengths=profile.named("_per_k"),
        )
    )
