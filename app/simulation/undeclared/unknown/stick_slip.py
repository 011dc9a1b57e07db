"""Stick and slip: a joint holds until the strain is too much, then gives way at once."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.simulation.undeclared.components import COMPONENTS, FloatArray
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.setting import Setting, driven

VARIANTS: Final = ("joint",)


def plant(setting: Setting, variant: str) -> Effect:
    """Let a joint store one component's expansion and release it in slips."""
    code = setting.choose_component()
    sensor = COMPONENTS[code].sensor
    holds_c = float(setting.rng.uniform(0.8, 2.0))
    strain = stored_strain(setting.rng, setting.history.temperatures_c[sensor], holds_c)
    profile = setting.choose_profile(code)
    return setting.scaled(
        Effect(
            "stick-slip",
            variant,
            (code,),
            {code: driven(profile, lambda circumstances: circumstances.at(strain))},
            sensors=(sensor,),
            parameters={"holds_c": holds_c},
            strengths=profile.named("_per_k"),
            in_library=False,
        )
    )


def stored_strain(
    rng: np.random.Generator, temperatures_c: FloatArray, holds_c: float
) -> FloatArray:
    """Follow the strain of a joint that sticks.

    Parameters
    ----------
    rng
        Source of chance: the joint never holds twice the same.
    temperatures_c : ndarray, shape (n,) [°C]
    holds_c
        Usual strain at which it slips, as the change of temperature that makes it [K].

    Returns
    -------
    ndarray, shape (n,) [K]
        Stored strain; a slip leaves a random fifth of it or less.
    """
    strains = np.empty(temperatures_c.size)
    strain, limit = 0.0, holds_c
    for i, change in enumerate(np.diff(temperatures_c, prepend=temperatures_c[0]).tolist()):
        strain += change
        if abs(strain) > limit:
            strain *= rng.uniform(0.0, 0.2)
            limit = holds_c * rng.uniform(0.6, 1.4)
        strains[i] = strain
    return strains
