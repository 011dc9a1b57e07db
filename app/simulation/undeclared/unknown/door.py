"""A door that opens: cold air strikes one side of the column, where no sensor sits.

The column bends towards the other side, so a straightness of Z and a squareness change together.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from app.simulation.undeclared.components import FloatArray
from app.simulation.undeclared.duty_cycle import DAY_MIN
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.history import low_pass
from app.simulation.undeclared.setting import Profile, Setting, driven

VARIANTS: Final = ("y", "x")
"""The side that is struck."""

SIDES: Final = {"y": ("EYZ", "SYZ"), "x": ("EXZ", "SZX")}


def plant(setting: Setting, variant: str) -> Effect:
    """Let draughts bend the column."""
    codes = [c for c in SIDES[variant] if c not in setting.taken]
    if not codes:
        codes = [setting.choose_component(SIDES[variant])]
    tau = float(setting.rng.uniform(12.0, 30.0))
    cold = low_pass(openings(setting.rng, setting.history.minutes), tau)
    profiles = {code: Profile(code, 1.0, 0.0 if code[0] == "S" else 1.0) for code in codes}
    strengths = {f"{c}_{k}": v for c, p in profiles.items() for k, v in p.named().items()}
    return setting.scaled(
        Effect(
            "door",
            variant,
            tuple(codes),
            {
                c: driven(p, lambda circumstances: circumstances.at(cold))
                for c, p in profiles.items()
            },
            parameters={"time_constant_min": tau},
            strengths=strengths,
            in_library=False,
        )
    )


def openings(rng: np.random.Generator, minutes: FloatArray) -> FloatArray:
    """Draw draughts: three to eight a day, of 8 to 40 minutes, each of its own strength.

    Parameters
    ----------
    minutes : ndarray, shape (n,) [min]
        One minute apart.

    Returns
    -------
    ndarray, shape (n,)
        0 where the door is shut.
    """
    opened = np.zeros(minutes.size)
    for day in range(minutes.size // DAY_MIN):
        for opens in rng.uniform(6.0 * 60, 22.0 * 60, rng.integers(3, 9)):
            begin = day * DAY_MIN + int(opens)
            opened[begin : begin + int(rng.integers(8, 41))] = rng.uniform(0.4, 1.0)
    return opened
