"""A pitch that changes along the axis: no single period fits."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.simulation.undeclared.base_machine import TRAVELS_MM
from app.simulation.undeclared.components import COMPONENTS, TRANSLATIONS, FloatArray
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.observations import Circumstances
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("linear",)


def plant(setting: Setting, variant: str) -> Effect:
    """Give one component a cyclic error whose frequency grows evenly along the axis."""
    code = setting.choose_component(TRANSLATIONS)
    axis = COMPONENTS[code].axis or 0
    first = float(setting.rng.uniform(24.0, 40.0))
    last = first * float(setting.rng.uniform(0.4, 0.7))
    phase = float(setting.rng.uniform(0.0, 2 * np.pi))
    growth = (1.0 / last - 1.0 / first) / (2.0 * TRAVELS_MM[axis])

    def error(circumstances: Circumstances) -> FloatArray:
        along = circumstances.point_mm[:, axis]
        return np.sin(2 * np.pi * (along / first + growth * along**2) + phase)

    return setting.scaled(
        Effect(
            "chirped-pitch",
            variant,
            (code,),
            {code: error},
            parameters={"first_pitch_mm": first, "last_pitch_mm": last, "phase_rad": phase},
            strengths={"amplitude_um": 1.0},
            in_library=False,
        )
    )
