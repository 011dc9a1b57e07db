"""Clamping bends what is measured: each visit has its own warp along one axis.

The declared set-up scatter is a shift and a tilt; a warp is of the second and third order, so it
is more than set-up scatter and yet follows nothing but the visit.
"""

from __future__ import annotations

from typing import Final

from benchmarks.undeclared.base_machine import normalised
from benchmarks.undeclared.components import COMPONENTS, TRANSLATIONS, FloatArray
from benchmarks.undeclared.effect import Effect
from benchmarks.undeclared.observations import Circumstances, ErrorFunction
from benchmarks.undeclared.setting import Setting

VARIANTS: Final = ("axis", "component")
"""All three translations of an axis, or one component."""


def plant(setting: Setting, variant: str) -> Effect:
    """Warp one axis or component in every visit anew."""
    chosen = setting.choose_component(TRANSLATIONS)
    codes = [chosen]
    if variant == "axis":
        codes = [c for c in TRANSLATIONS if c[2] == chosen[2] and c not in setting.taken]
    visits = int(setting.observations.visit.max()) + 1
    warps = {code: setting.rng.standard_normal((visits, 2)) for code in codes}
    return setting.scaled(
        Effect(
            "setup-warp",
            variant,
            tuple(codes),
            {code: _warp(code, of_visits) for code, of_visits in warps.items()},
            strengths={"second_order_um": 1.0, "third_order_um": 1.0},
            in_library=False,
        )
    )


def _warp(code: str, of_visits: FloatArray) -> ErrorFunction:
    """Make the Legendre polynomials of the second and third order with a visit's coefficients."""
    axis = COMPONENTS[code].axis or 0

    def error(circumstances: Circumstances) -> FloatArray:
        u = normalised(code, circumstances.point_mm[:, axis])
        second, third = of_visits[circumstances.observations.visit].T
        warp: FloatArray = second * (3 * u**2 - 1) / 2 + third * (5 * u**3 - 3 * u) / 2
        return warp

    return error
