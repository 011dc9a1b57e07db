"""Two bodies one behind the other: a lag of 60 and then of 25 minutes.

A single time constant comes near it, with the right family and an incomplete shape.
"""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.components import COMPONENTS
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.history import low_pass
from app.simulation.undeclared.planted.thermal_lag import choose_codes, late_error
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("component", "sensor")
TIME_CONSTANTS_MIN: Final = (60.0, 25.0)


def plant(setting: Setting, variant: str) -> Effect:
    """Plant a lag of the second order."""
    codes = choose_codes(setting, variant)
    sensor = COMPONENTS[codes[0]].sensor
    late = setting.history.temperatures_c[sensor]
    for tau in TIME_CONSTANTS_MIN:
        late = low_pass(late, tau)
    return setting.scaled(
        Effect(
            "second-time-constant",
            variant,
            codes,
            {code: late_error(setting, code, late) for code in codes},
            sensors=(sensor,),
            parameters={"time_constants_min": list(TIME_CONSTANTS_MIN)},
            sensitive=codes,
            in_library=False,
        )
    )
