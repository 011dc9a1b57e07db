"""Linear in time from the first visit: wear, creep, settling."""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.components import FloatArray
from app.simulation.undeclared.duty_cycle import DAY_MIN
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.observations import Circumstances
from app.simulation.undeclared.setting import Setting, driven

VARIANTS: Final = ("component",)


def plant(setting: Setting, variant: str) -> Effect:
    """Let one component drift."""
    code = setting.choose_component()
    profile = setting.choose_profile(code)
    begins = float(setting.visit_times_min[0])

    def days(circumstances: Circumstances) -> FloatArray:
        return (circumstances.time_min - begins) / DAY_MIN

    return setting.scaled(
        Effect(
            "drift",
            variant,
            (code,),
            {code: driven(profile, days)},
            parameters={"from_min": begins},
            strengths=profile.named("_per_day"),
        )
    )
