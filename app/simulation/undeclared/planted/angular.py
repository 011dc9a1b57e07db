"""A roll, pitch or yaw that the maps lack: it shows at points, through lever arms and tool.

The maps leave the component out; the machine has all of it.
"""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.setting import Profile, Setting

VARIANTS: Final = ("roll", "pitch", "yaw")

CODES_OF: Final = {
    "roll": ("EAX", "EBY", "ECZ"),
    "pitch": ("EBX", "EAY", "EAZ"),
    "yaw": ("ECX", "ECY", "EBZ"),
}
"""Rotation about the axis of motion, about a horizontal one across it, about the third."""


def plant(setting: Setting, variant: str) -> Effect:
    """Give one axis a rotation that no map has."""
    candidates = [code for code in CODES_OF[variant] if _is_visible(setting, code)]
    code = setting.choose_component(candidates)
    profile = setting.choose_profile(code)
    return setting.scaled(
        Effect(
            "angular",
            variant,
            (code,),
            {code: profile},
            strengths=profile.named(),
            unmeasured=(code,),
        )
    )


def _is_visible(setting: Setting, code: str) -> bool:
    """Whether it moves the tool's tip: the roll of Z turns about a tool that lies in Z."""
    effect = Effect("angular", "", (code,), {code: Profile(code, 1.0, 0.0)}, unmeasured=(code,))
    return setting.amplitude(effect) > 0.0
