"""Clamping bends what is measured: each visit has its own warp along one axis.

The declared set-up scatter is a shift and a tilt; a warp is of the second and third order, so it
is more than set-up scatter and yet follows nothing but the visit.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from app.simulation.undeclared.base_machine import normalised
from app.simulation.undeclared.components import COMPONENTS, TRANSLATIONS, FloatArray
from app.simulation.undeclared.conditions import Conditions
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.observations import Circumstances, ErrorFunction
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("axis", "component")
"""All three translations of an axis, or one component."""


def plant(setting: Setting, variant: str) -> Effect:
    """Warp one axis or component in every visit anew."""
    chosen = setting.choose_component(TRANSLATIONS)
    codes = [chosen]
    if variant == "axis":
        codes = [c for c in TRANSLATIONS if c[2] == chosen[2] and c not in setting.taken]
    under = setting.conditions
    last = under.setup_of(np.array([under.visits + under.later_visits - 1]))
    warps = {code: setting.rng.standard_normal((int(last[0]) + 1, 2)) for code in codes}
    return setting.scaled(
        Effect(
            "setup-warp",
            variant,
            tuple(codes),
            {code: _warp(code, of_setups, under) for code, of_setups in warps.items()},
            strengths={"second_order_um": 1.0, "third_order_um": 1.0},
            in_library=False,
        )
    )


def _warp(code: str, of_setups: FloatArray, under: Conditions) -> ErrorFunction:
    """Make the Legendre polynomials of the second and third order with a set-up's coefficients."""
    axis = COMPONENTS[code].axis or 0

    def error(circumstances: Circumstances) -> FloatArray:
        u = normalised(code, circumstances.point_mm[:, axis])
        second, third = of_setups[under.setup_of(circumstances.observations.visit)].T
        warp: FloatArray = second * (3 * u**2 - 1) / 2 + third * (5 * u**3 - 3 * u) / 2
        return warp

    return error
