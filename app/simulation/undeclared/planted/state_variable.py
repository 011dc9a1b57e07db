"""A state of the machine acts: spindle speed, its square, payload or feed.

At once, or through a body with a time constant that no sensor sees. The maps were measured at
rest and without payload, so they have nothing of it.
"""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.components import FloatArray
from app.simulation.undeclared.duty_cycle import FASTEST_FEED_MM_PER_MIN, FASTEST_RPM, PAYLOADS_KG
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.history import low_pass
from app.simulation.undeclared.observations import Circumstances
from app.simulation.undeclared.setting import Setting, driven

VARIANTS: Final = (
    "speed",
    "speed-squared",
    "payload",
    "feed",
    "speed-lagged",
    "speed-squared-lagged",
    "feed-lagged",
)

_OF_VARIANT: Final = {
    "speed": ("spindle_rpm", FASTEST_RPM, 1),
    "speed-squared": ("spindle_rpm", FASTEST_RPM, 2),
    "payload": ("payload_kg", PAYLOADS_KG[-1], 1),
    "feed": ("feed_mm_per_min", FASTEST_FEED_MM_PER_MIN, 1),
}
"""Name in the state, its largest value, and power."""


def plant(setting: Setting, variant: str) -> Effect:
    """Let a state act on one component."""
    code = setting.choose_component()
    name, largest, power = _OF_VARIANT[variant.removesuffix("-lagged")]
    profile = setting.choose_profile(code)
    series = (setting.history.state[name] / largest) ** power
    parameters: dict[str, float | str] = {"state": name, "power": power, "full_scale": largest}
    is_late = variant.endswith("-lagged")
    if is_late:
        tau = setting.choose_time_constant_min(20.0, 120.0)
        series = low_pass(series, tau)
        parameters["time_constant_min"] = tau

    def driver(circumstances: Circumstances) -> FloatArray:
        if is_late:
            return circumstances.at(series)
        return circumstances.history.hold(series, circumstances.time_min)

    return setting.scaled(
        Effect(
            "state-variable",
            variant,
            (code,),
            {code: driven(profile, driver)},
            parameters=parameters,
            strengths=profile.named("_at_full_scale"),
        )
    )
