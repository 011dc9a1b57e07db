"""A sensor ages: from the first reading on its bias grows evenly."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.simulation.undeclared.components import ASSIGNED_SENSORS
from app.simulation.undeclared.duty_cycle import DAY_MIN
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.planted.sensor_fault import fitted, misread
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("drifting",)

AT_END_C: Final = (1.0, 3.0)


def plant(setting: Setting, variant: str) -> Effect:
    """Let one of the sensors that components follow age during the visits."""
    sensor = str(setting.rng.choice(ASSIGNED_SENSORS))
    times_min = setting.visit_times_min
    since_min, days = float(times_min[0]), float(np.ptp(times_min)) / DAY_MIN
    at_end_c = float(setting.rng.choice([-1.0, 1.0]) * setting.rng.uniform(*AT_END_C))
    grown = np.maximum(setting.history.minutes - since_min, 0.0) / DAY_MIN
    shown_c = setting.history.temperatures_c[sensor] + at_end_c / days * grown
    parameters = {"bias_c_per_day": at_end_c / days, "since_min": since_min}
    effect = misread(setting, "ageing-sensor", variant, {sensor: shown_c}, dict(parameters))
    return fitted(setting, effect)
