"""A component grows with another axis' position, as the weight of a table bends its bed.

Slope × coordinate, the slope itself growing along the component's axis: a constant one would
be a squareness. On the component's own line the other axes stand at 0 and nothing is seen.
"""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.components import (
    AXES,
    COMPONENTS,
    MM_PER_M,
    ROTATIONS,
    TRANSLATIONS,
    FloatArray,
)
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.observations import Circumstances
from app.simulation.undeclared.setting import Profile, Setting, driven

VARIANTS: Final = ("linear", "angular")
"""The slope of a displacement or straightness, or of a rotation."""


def plant(setting: Setting, variant: str) -> Effect:
    """Let one component grow with the position of another axis."""
    # The roll of Z turns about the tool, and does not move its tip.
    levered = [code for code in ROTATIONS if code != "ECZ"]
    code = setting.choose_component(TRANSLATIONS if variant == "linear" else levered)
    axis = COMPONENTS[code].axis
    other = int(setting.rng.choice([i for i in range(3) if i != axis]))
    profile = Profile(code, float(setting.rng.uniform(-0.3, 0.3)), 1.0)

    def coordinate_m(circumstances: Circumstances) -> FloatArray:
        return circumstances.point_mm[:, other] / MM_PER_M

    return setting.scaled(
        Effect(
            "nonrigid-slope",
            variant,
            (code,),
            {code: driven(profile, coordinate_m)},
            parameters={"slope": f"{code}^{AXES[other]}", "coordinate": AXES[other]},
            strengths=profile.named("_per_m"),
        )
    )
