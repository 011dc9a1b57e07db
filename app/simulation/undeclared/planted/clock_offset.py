"""Observations were noted at other times than they were made, all by as much."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.observations import Observations, true_errors
from app.simulation.undeclared.planted.sensor_fault import fitted
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("an-hour-early", "an-hour-late", "some-minutes")

HOUR_MIN: Final = 60.0
SOME_MIN: Final = (20.0, 45.0)


def plant(setting: Setting, variant: str) -> Effect:
    """Note all observations too early or too late."""
    offset_min = {"an-hour-early": -HOUR_MIN, "an-hour-late": HOUR_MIN}.get(variant)
    if offset_min is None:
        offset_min = float(setting.rng.choice([-1.0, 1.0]) * setting.rng.uniform(*SOME_MIN))
    codes = tuple(sorted(setting.machine.measured_codes))

    def reported(observations: Observations) -> Observations:
        return replace(observations, time_min=observations.time_min + offset_min)

    return fitted(
        setting,
        Effect(
            "clock-offset",
            variant,
            codes,
            true_errors(setting.machine),
            parameters={"noted_later_by_min": offset_min},
            sensitive=codes,
            reported=reported,
        ),
    )
