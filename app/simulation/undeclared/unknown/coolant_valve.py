"""A valve that nobody logs: it opens and closes at random while the machine works."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.simulation.undeclared.components import BoolArray, FloatArray
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.history import low_pass
from app.simulation.undeclared.setting import Setting, driven

VARIANTS: Final = ("unlogged",)


def plant(setting: Setting, variant: str) -> Effect:
    """Let a hidden valve act on one component, within minutes."""
    code = setting.choose_component()
    tau = float(setting.rng.uniform(4.0, 12.0))
    acts = low_pass(random_switch(setting.rng, setting.history.working, 70.0), tau)
    profile = setting.choose_profile(code)
    return setting.scaled(
        Effect(
            "coolant-valve",
            variant,
            (code,),
            {code: driven(profile, lambda circumstances: circumstances.at(acts))},
            parameters={"time_constant_min": tau},
            strengths=profile.named(),
            in_library=False,
        )
    )


def random_switch(rng: np.random.Generator, may: BoolArray, mean_min: float) -> FloatArray:
    """Switch on and off at random moments.

    Parameters
    ----------
    may : ndarray of bool, shape (n,)
        Minutes in which it can be on.
    mean_min
        Mean duration of either state [min].

    Returns
    -------
    ndarray, shape (n,)
        0 or 1.
    """
    durations = rng.exponential(mean_min, int(3 * may.size / mean_min) + 20)
    turns = np.cumsum(durations)
    state = np.searchsorted(turns, np.arange(may.size)) % 2
    switched: FloatArray = state * may.astype(float)
    return switched
