"""True hysteresis: the error remembers where the temperature turned back, not how fast it went.

A Preisach model (F. Preisach, Z. Phys. 94, 277 (1935)): relays that switch up at α and down at
β < α. Its output at a temperature depends on the past extremes alone, whatever the speed; a small
loop closes where it began. What is linear in the temperature is taken off, as maps would have it.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from app.simulation.undeclared.components import COMPONENTS, FloatArray
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.setting import Setting, driven

VARIANTS: Final = ("preisach",)

LEVELS: Final = 60
"""Thresholds over the range of temperatures."""


def plant(setting: Setting, variant: str) -> Effect:
    """Let one component follow its sensor with hysteresis."""
    code = setting.choose_component()
    sensor = COMPONENTS[code].sensor
    temperatures = setting.history.temperatures_c[sensor]
    width = float(setting.rng.uniform(0.15, 0.3))
    weights = relay_weights(LEVELS, width)
    output = preisach(temperatures, weights)
    line = np.polynomial.Polynomial.fit(temperatures, output, 1)
    rest = output - line(temperatures)
    profile = setting.choose_profile(code)
    return setting.scaled(
        Effect(
            "hysteresis",
            variant,
            (code,),
            {code: driven(profile, lambda circumstances: circumstances.at(rest))},
            sensors=(sensor,),
            parameters={"half_width_of_range": width},
            strengths=profile.named(),
            in_library=False,
        )
    )


def relay_weights(levels: int, half_width: float) -> FloatArray:
    """Weigh relays: most of those whose thresholds lie some way apart.

    Parameters
    ----------
    levels
        Number of thresholds over the range.

    Returns
    -------
    ndarray, shape (levels, levels)
        Weight of the relay that switches up at the first and down at the second index's level;
        zero where that is no relay. Their sum is 1.
    """
    up, down = np.meshgrid(np.arange(levels), np.arange(levels), indexing="ij")
    apart = (up - down) / levels
    weights = np.where(up >= down, np.exp(-(((apart / 2 - half_width) / 0.1) ** 2)), 0.0)
    normalised: FloatArray = weights / weights.sum()
    return normalised


def preisach(series: FloatArray, weights: FloatArray) -> FloatArray:
    """Drive all relays by a series.

    Parameters
    ----------
    series : ndarray, shape (n,)
        The input; its range sets the thresholds.
    weights : ndarray, shape (k, k)
        As `relay_weights`.

    Returns
    -------
    ndarray, shape (n,)
        From −1, all relays down, to 1, all up.
    """
    levels = weights.shape[0]
    low, high = series.min(), series.max()
    reached = np.clip((series - low) / (high - low) * levels, 0.0, levels)
    # The level that the input stands on: relays up to it are up, relays above it down.
    step = np.floor(reached).astype(int)
    is_up = np.zeros(weights.shape, dtype=bool)
    places = np.arange(levels)
    output = np.empty(series.size)
    value, last = -1.0, -1
    for i, now in enumerate(step):
        if now != last:
            is_up[places < now, :] = True
            is_up[:, places >= now] = False
            value = 2.0 * float(weights[is_up].sum()) - 1.0
            last = now
        output[i] = value
    return output
