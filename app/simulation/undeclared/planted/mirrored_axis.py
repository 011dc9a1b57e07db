"""Positions were noted from the other end of an axis: of all that was measured along it, or a line.

The machine is what it is, so the effect has the size that its errors have.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from app.simulation.undeclared.base_machine import TRAVELS_MM
from app.simulation.undeclared.components import AXES, CODES, COMPONENTS, TRANSLATIONS
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.observations import Observations, true_errors
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("axis", "one-line")


def plant(setting: Setting, variant: str) -> Effect:
    """Mirror an axis about the middle of its travel."""
    axis = int(setting.rng.integers(3))
    codes = tuple(c for c in CODES if COMPONENTS[c].axis == axis)
    if variant == "one-line":
        codes = (setting.choose_component([c for c in TRANSLATIONS if c in codes]),)
    codes = tuple(c for c in codes if c in setting.machine.measured_codes)
    numbers = [CODES.index(code) for code in codes]

    def reported(observations: Observations) -> Observations:
        mirrored = np.isin(observations.component, numbers)
        mirrored |= observations.is_point & (variant == "axis")
        point_mm, direction = observations.point_mm.copy(), observations.direction.copy()
        point_mm[mirrored, axis] = TRAVELS_MM[axis] - point_mm[mirrored, axis]
        direction[mirrored, axis] *= -1
        return replace(observations, point_mm=point_mm, direction=direction)

    return Effect(
        "mirrored-axis",
        variant,
        codes,
        true_errors(setting.machine),
        parameters={"axis": AXES[axis]},
        reported=reported,
    )
