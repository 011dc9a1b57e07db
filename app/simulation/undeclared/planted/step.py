"""A change at one time, between two visits: a collision, a re-levelling."""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.components import SQUARENESS, FloatArray
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.observations import Circumstances
from app.simulation.undeclared.setting import Setting, driven

VARIANTS: Final = ("component", "squareness")


def plant(setting: Setting, variant: str) -> Effect:
    """Change one component at one time."""
    code = setting.choose_component(SQUARENESS if variant == "squareness" else None)
    profile = setting.choose_profile(code)
    moment = setting.choose_moment_min()

    def has_happened(circumstances: Circumstances) -> FloatArray:
        return (circumstances.time_min >= moment).astype(float)

    return setting.scaled(
        Effect(
            "step",
            variant,
            (code,),
            {code: driven(profile, has_happened)},
            parameters={"at_min": moment},
            strengths=profile.named(),
        )
    )
