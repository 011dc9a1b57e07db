"""Effects that are in none of the families: what an honest search calls unexplained.

Some of them resemble a family closely (a second time constant a lag, a chirped pitch a
periodic error): a finding of that family beside unexplained structure is then a proxy.
"""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.planted import Family
from app.simulation.undeclared.unknown import (
    bent_by_difference,
    chirped_pitch,
    coolant_valve,
    door,
    hysteresis,
    interaction,
    second_time_constant,
    setup_warp,
    slow_cause,
    stick_slip,
)

UNKNOWN: Final = {
    "hysteresis": Family(hysteresis.VARIANTS, hysteresis.plant),
    "coolant-valve": Family(coolant_valve.VARIANTS, coolant_valve.plant),
    "door": Family(door.VARIANTS, door.plant),
    "stick-slip": Family(stick_slip.VARIANTS, stick_slip.plant),
    "interaction": Family(interaction.VARIANTS, interaction.plant),
    "second-time-constant": Family(second_time_constant.VARIANTS, second_time_constant.plant),
    "chirped-pitch": Family(chirped_pitch.VARIANTS, chirped_pitch.plant),
    "slow-cause": Family(slow_cause.VARIANTS, slow_cause.plant),
    "setup-warp": Family(setup_warp.VARIANTS, setup_warp.plant),
    "bent-by-difference": Family(bent_by_difference.VARIANTS, bent_by_difference.plant),
}
"""What nobody searches."""
