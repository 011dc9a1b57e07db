"""Tools are shorter than was stated beside the points: their angles act elsewhere.

The machine is what it is, so the effect has the size that its angles give it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from app.simulation.undeclared.components import ROTATIONS
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.observations import Observations, true_errors
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("one-tool", "every-tool")

OFF_MM: Final = (100.0, 200.0)


def plant(setting: Setting, variant: str) -> Effect:
    """State one tool, or all of them, too long."""
    lengths = np.linalg.norm(setting.observations.tool_mm, axis=1).round(3)
    tools_in_use = np.unique(lengths[lengths > 0.0])
    length_mm = float(setting.rng.choice(tools_in_use))
    off_mm = float(np.round(setting.rng.uniform(*OFF_MM)))

    def reported(observations: Observations) -> Observations:
        size = np.linalg.norm(observations.tool_mm, axis=1)
        concerned = size > 0.0 if variant == "every-tool" else size.round(3) == length_mm
        tool_mm = observations.tool_mm.copy()
        tool_mm[concerned] *= (1.0 + off_mm / size[concerned])[:, None]
        return replace(observations, tool_mm=tool_mm)

    return Effect(
        "tool-length",
        variant,
        tuple(code for code in ROTATIONS if code in setting.machine.measured_codes),
        true_errors(setting.machine),
        parameters={
            "longer_by_mm": -off_mm,
            "tool_mm": length_mm if variant == "one-tool" else 0.0,
        },
        reported=reported,
    )
