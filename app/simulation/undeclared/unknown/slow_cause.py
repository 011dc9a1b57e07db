"""A slow cause that nobody observes: a wave of five to nine hours whose phase wanders."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.setting import Setting, driven

VARIANTS: Final = ("wandering",)
WANDER_RAD: Final = 0.5
"""Standard deviation of the phase after one period."""


def plant(setting: Setting, variant: str) -> Effect:
    """Let a hidden wave act on one component."""
    code = setting.choose_component()
    period = float(setting.rng.uniform(5.0, 9.0) * 60.0)
    n = setting.history.minutes.size
    steps = setting.rng.standard_normal(n) * WANDER_RAD / np.sqrt(period)
    begins = setting.rng.uniform(0.0, 2 * np.pi)
    wave = np.sin(2 * np.pi * np.arange(n) / period + begins + np.cumsum(steps))
    profile = setting.choose_profile(code)
    return setting.scaled(
        Effect(
            "slow-cause",
            variant,
            (code,),
            {code: driven(profile, lambda circumstances: circumstances.at(wave))},
            parameters={"period_min": period},
            strengths=profile.named(),
            in_library=False,
        )
    )
