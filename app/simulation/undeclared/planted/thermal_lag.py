"""The structure answers its sensor late.

E(u, T) becomes E(u, y) with τ·dy/dt = T − y. How much that is follows from τ and the component's
thermal sensitivity; so the wanted amplitude is reached by the sensitivity, and the lag is whole.
"""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.components import (
    ASSIGNED_SENSORS,
    COMPONENTS,
    FloatArray,
    following,
)
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.history import low_pass
from app.simulation.undeclared.observations import Circumstances, ErrorFunction
from app.simulation.undeclared.setting import Setting

VARIANTS: Final = ("component", "sensor")
"""One component lags, or all that follow a sensor."""


def plant(setting: Setting, variant: str) -> Effect:
    """Plant a lag of one component, or one fingerprint over all components of a sensor."""
    codes = choose_codes(setting, variant)
    sensor = COMPONENTS[codes[0]].sensor
    tau = setting.choose_time_constant_min()
    late = low_pass(setting.history.temperatures_c[sensor], tau)
    return setting.scaled(
        Effect(
            "thermal-lag",
            variant,
            codes,
            {code: late_error(setting, code, late) for code in codes},
            sensors=(sensor,),
            parameters={"time_constant_min": tau},
            sensitive=codes,
        )
    )


def choose_codes(setting: Setting, variant: str) -> tuple[str, ...]:
    """Choose one component, or all of a sensor of which no other effect has one."""
    if variant == "component":
        return (setting.choose_component(),)
    measured = {
        sensor: tuple(c for c in following(sensor) if c not in setting.machine.unmeasured)
        for sensor in ASSIGNED_SENSORS
    }
    free = [sensor for sensor, codes in measured.items() if not setting.taken.intersection(codes)]
    if not free:
        raise ValueError("expected a sensor none of whose components has an effect, got none")
    return measured[str(setting.rng.choice(free))]


def late_error(setting: Setting, code: str, late_c: FloatArray) -> ErrorFunction:
    """Make the difference between the component's error at a late temperature and at the true one.

    Parameters
    ----------
    late_c : ndarray, shape (n,) [°C]
        Late temperature in all minutes of the history.
    """
    table = setting.machine.table(code)
    axis = COMPONENTS[code].axis or 0

    def error(circumstances: Circumstances) -> FloatArray:
        position = circumstances.point_mm[:, axis]
        now = circumstances.temperature(COMPONENTS[code].sensor)
        return table.at(position, circumstances.at(late_c)) - table.at(position, now)

    return error
