"""A sensor came half off after the maps: it shows something between its body and the room."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from app.simulation.undeclared.components import ASSIGNED_SENSORS
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.planted.sensor_fault import fitted, misread
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("in-the-room",)

SHARES: Final = (0.4, 0.8)
"""Of its body in what the sensor shows."""


def plant(setting: Setting, variant: str) -> Effect:
    """Let one of the sensors that components follow come half off."""
    sensor = str(setting.rng.choice(ASSIGNED_SENSORS))
    share = float(setting.rng.uniform(*SHARES))
    true_c = setting.history.temperatures_c
    shown_c = share * true_c[sensor] + (1.0 - share) * true_c["ambient"]
    effect = misread(setting, "detached-sensor", variant, {sensor: shown_c}, {"share": share})
    return replace(fitted(setting, effect), sensors=(sensor, "ambient"))
