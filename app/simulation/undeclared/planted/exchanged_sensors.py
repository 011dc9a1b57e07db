"""Two sensors' plugs are exchanged after the maps were measured.

The machine's errors stay what they are; the model asks its maps at the other place's temperature.
"""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.components import ASSIGNED_SENSORS
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.planted.sensor_fault import fitted, misread
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("both-followed", "one-followed")


def plant(setting: Setting, variant: str) -> Effect:
    """Exchange the two sensors that components follow, or one of them and another."""
    if variant == "both-followed":
        first, other = ASSIGNED_SENSORS
    else:
        first = str(setting.rng.choice(ASSIGNED_SENSORS))
        other = setting.choose_other_sensor(first, but=ASSIGNED_SENSORS)
    true_c = setting.history.temperatures_c
    shown_c = {first: true_c[other], other: true_c[first]}
    return fitted(setting, misread(setting, "exchanged-sensors", variant, shown_c, {}))
