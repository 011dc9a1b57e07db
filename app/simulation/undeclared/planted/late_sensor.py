"""A sensor reports late: what it shows was so some time ago."""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.components import ASSIGNED_SENSORS
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.planted.sensor_fault import fitted, misread
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("by-a-buffer",)

LATE_MIN: Final = (10.0, 40.0)


def plant(setting: Setting, variant: str) -> Effect:
    """Let one of the sensors that components follow report late."""
    sensor = str(setting.rng.choice(ASSIGNED_SENSORS))
    late_min = float(setting.rng.uniform(*LATE_MIN))
    history = setting.history
    shown_c = history.at(history.temperatures_c[sensor], history.minutes - late_min)
    effect = misread(setting, "late-sensor", variant, {sensor: shown_c}, {"late_min": late_min})
    return fitted(setting, effect)
