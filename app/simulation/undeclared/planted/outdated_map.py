"""The tables themselves no longer hold: a shift, a slope or a profile, constant in time."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.simulation.undeclared.base_machine import normalised
from app.simulation.undeclared.components import COMPONENTS, ROTATIONS, TRANSLATIONS, FloatArray
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.observations import Circumstances
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("shift", "slope", "profile")


def plant(setting: Setting, variant: str) -> Effect:
    """Change one component's table since it was measured.

    A shift is the same in all values, so its amplitude is their root mean square.
    """
    code = setting.choose_component(None if variant == "shift" else TRANSLATIONS + ROTATIONS[:6])
    axis = COMPONENTS[code].axis or 0
    legendre = coefficients(setting.rng, variant)

    def error(circumstances: Circumstances) -> FloatArray:
        u = normalised(code, circumstances.point_mm[:, axis])
        return np.asarray(np.polynomial.legendre.legval(u, legendre), dtype=np.float64)

    return setting.scaled(
        Effect(
            "outdated-map",
            variant,
            (code,),
            {code: error},
            strengths={f"legendre_{COMPONENTS[code].unit}": legendre},
            about_zero=variant == "shift",
        )
    )


def coefficients(rng: np.random.Generator, variant: str) -> list[float]:
    """Coefficients of the Legendre polynomials over the travel, from the constant one on."""
    sign = float(rng.choice([-1.0, 1.0]))
    if variant == "shift":
        return [sign]
    if variant == "slope":
        return [0.0, sign]
    return [0.0, 0.0, *(float(c) for c in rng.uniform(0.3, 1.0, 3) * rng.choice([-1, 1], 3))]
