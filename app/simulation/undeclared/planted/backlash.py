"""Reversal: half the value with the sign of the approach; constant, or growing along the axis.

The maps have the mean of both directions.
"""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.components import AXES, COMPONENTS, TRANSLATIONS, FloatArray
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.observations import Circumstances
from app.simulation.undeclared.setting import Profile, Setting, driven

VARIANTS: Final = ("constant", "along-axis")


def plant(setting: Setting, variant: str) -> Effect:
    """Give one axis a reversal error: usually in its own direction, now and then across."""
    along = [code for code in TRANSLATIONS if COMPONENTS[code].row == COMPONENTS[code].axis]
    across = [code for code in TRANSLATIONS if code not in along]
    code = setting.choose_component(along if setting.rng.uniform() < 0.7 else across)
    slope = 0.0 if variant == "constant" else float(setting.rng.choice([-1, 1]))
    profile = Profile(code, -1.0, slope * setting.rng.uniform(0.4, 0.8))
    axis = COMPONENTS[code].axis or 0

    def approach(circumstances: Circumstances) -> FloatArray:
        return circumstances.observations.direction[:, axis]

    return setting.scaled(
        Effect(
            "backlash",
            variant,
            (code,),
            {code: driven(profile, approach)},
            parameters={"axis": AXES[axis]},
            strengths={f"half_{name}": value for name, value in profile.named().items()},
        )
    )
