"""Bending with the difference of two sensors, of which the maps know nothing.

What the difference does everywhere alike is larger than the bend along the axis. An instrument
that is zeroed in every visit shows the bend alone, and whatever explains it says something of the
rest too, which nobody saw.
"""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.base_machine import normalised
from app.simulation.undeclared.components import COMPONENTS, TRANSLATIONS, FloatArray
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.observations import Circumstances
from app.simulation.undeclared.planted.sensor_gradient import PAIRS
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("cantilever",)

BENDS: Final = (0.5, 1.0)
"""What the far end bends by, in parts of what is the same everywhere."""


def plant(setting: Setting, variant: str) -> Effect:
    """Let a difference push one component, and bend it as a beam that is held at one end."""
    code = setting.choose_component(TRANSLATIONS)
    axis = COMPONENTS[code].axis or 0
    warm, cold = PAIRS[int(setting.rng.integers(len(PAIRS)))]
    bend = float(setting.rng.uniform(*BENDS) * setting.rng.choice([-1.0, 1.0]))
    in_balance = setting.machine.map_temperatures_c
    middle = in_balance[warm].size // 2
    balance_k = float(in_balance[warm][middle] - in_balance[cold][middle])

    def error(circumstances: Circumstances) -> FloatArray:
        along = (normalised(code, circumstances.point_mm[:, axis]) + 1.0) / 2.0
        difference = circumstances.temperature(warm) - circumstances.temperature(cold)
        return (1.0 + bend * along**2) * (difference - balance_k)

    return setting.scaled(
        Effect(
            "bent-by-difference",
            variant,
            (code,),
            {code: error},
            sensors=(warm, cold),
            parameters={"balance_k": balance_k},
            strengths={"everywhere_um_per_k": 1.0, "bend_um_per_k": bend},
            in_library=False,
        )
    )
