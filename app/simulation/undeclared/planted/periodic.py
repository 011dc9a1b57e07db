"""A sine over position: the pitch of a screw, the period of a scale; its maps have missed it."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.simulation.undeclared.base_machine import POSITIONS, TRAVELS_MM
from app.simulation.undeclared.components import COMPONENTS, TRANSLATIONS, FloatArray
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.observations import Circumstances
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("single", "harmonic")
"""A pure sine, or one with its second harmonic."""


def plant(setting: Setting, variant: str) -> Effect:
    """Give one component a cyclic error along its axis."""
    code = setting.choose_component(TRANSLATIONS)
    axis = COMPONENTS[code].axis or 0
    pitch = choose_pitch_mm(setting.rng, TRAVELS_MM[axis] / (POSITIONS - 1))
    phase, second_phase = setting.rng.uniform(0.0, 2 * np.pi, 2).tolist()
    share = 0.4 if variant == "harmonic" else 0.0
    parameters: dict[str, float] = {"pitch_mm": pitch, "phase_rad": phase}
    strengths = {"first_um": 1.0}
    if share:
        parameters["second_phase_rad"] = second_phase
        strengths["second_um"] = share

    def error(circumstances: Circumstances) -> FloatArray:
        turns = 2 * np.pi * circumstances.point_mm[:, axis] / pitch
        wave: FloatArray = np.sin(turns + phase) + share * np.sin(2 * turns + second_phase)
        return wave

    return setting.scaled(
        Effect(
            "periodic",
            variant,
            (code,),
            {code: error},
            parameters=parameters,
            strengths=strengths,
        )
    )


def choose_pitch_mm(rng: np.random.Generator, step_mm: float) -> float:
    """Choose a pitch of 8 to 40 mm that no multiple of brings near the maps' step.

    Parameters
    ----------
    step_mm
        Distance of the maps' positions [mm].

    Returns
    -------
    float
        At least a tenth of a turn from any whole number of turns in a step.
    """
    while True:
        pitch = float(rng.uniform(8.0, 40.0))
        turns = step_mm / pitch
        if abs(turns - round(turns)) > 0.1:
            return pitch
