"""What the machine's structure does with heat in another way than its maps have it."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.simulation.undeclared.components import ASSIGNED_SENSORS, COMPONENTS, FloatArray, following
from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.history import low_pass
from app.simulation.undeclared.observations import Circumstances, ErrorFunction
from app.simulation.undeclared.setting import Profile, Setting, table_difference

EXPANSION: Final = "expansion"
LATE: Final = "late"

LATE_MIN: Final = (20.0, 160.0)
"""Time constants of what is late [min]."""

LENGTHS: Final = ("EXX", "EYY", "EZZ")

PAIRS: Final = (
    ("z-column", "column-rear"),
    ("spindle", "z-column"),
    ("x-middle", "bed"),
    ("bed", "ambient"),
)
"""Across the column, headstock to column, table to bed, bed to room."""


def thermal_lag(setting: Setting) -> Effect:
    """Let one component, or all that follow a sensor, answer their sensor late.

    E(u, T) becomes E(u, y) with τ·dy/dt = T − y. How much that is follows from τ and the
    component's thermal sensitivity; so the wanted amplitude is reached by the sensitivity, and the
    lag is whole.
    """
    codes = lagging_codes(setting)
    sensor = COMPONENTS[codes[0]].sensor
    tau = setting.choose_time_constant_min()
    late = low_pass(setting.history.temperatures_c[sensor], tau)
    return setting.planted(
        {code: late_error(setting, code, late) for code in codes},
        sensors=(sensor,),
        parameters={"time_constant_min": tau},
        sensitive=codes,
    )


def lagging_codes(setting: Setting) -> tuple[str, ...]:
    """Choose one component, or all of a sensor of which no other effect has one."""
    if setting.variant == "component":
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
    return table_difference(code, table, table, first_c=late_c)


def other_sensor(setting: Setting) -> Effect:
    """Let one component follow another sensor than the assigned one.

    Its error lies between the maps according to the other sensor's temperature. The wanted
    amplitude is reached by the component's thermal sensitivity, so that it follows altogether.
    """
    code = setting.choose_component()
    assigned = COMPONENTS[code].sensor
    other = setting.choose_other_sensor(assigned)
    table = setting.machine.table(code)
    by_other = table.with_temperatures(setting.machine.map_temperatures_c[other])
    other_c = setting.history.temperatures_c[other]
    return setting.planted(
        {code: table_difference(code, by_other, table, first_c=other_c)},
        sensors=(other,),
        parameters={"assigned_sensor": assigned},
        sensitive=(code,),
    )


def additional_sensor(setting: Setting) -> Effect:
    """Let one component grow with another sensor's temperature too.

    At once, or late: then it grows with what a body follows that no sensor sees; in the thermal
    states of the maps that body was in balance. As an expansion a positioning error grows in
    proportion to the length from the axis' zero, as a scale does.
    """
    expands = setting.variant == EXPANSION
    code = setting.choose_component(LENGTHS if expands else None)
    assigned = COMPONENTS[code].sensor
    second = setting.choose_other_sensor(assigned)
    profile = setting.choose_profile(code)
    if expands:
        profile = Profile(code, profile.level, profile.level)
    return _following_series(
        setting,
        profile,
        setting.history.temperatures_c[second],
        setting.machine.map_temperatures_c[second],
        (second,),
        {"assigned_sensor": assigned},
    )


def sensor_gradient(setting: Setting) -> Effect:
    """Bend one component by the difference of two neighbouring bodies, at once or late."""
    code = setting.choose_component()
    warm, cold = PAIRS[int(setting.rng.integers(len(PAIRS)))]
    profile = setting.choose_profile(code)
    of_maps, of_bodies = setting.machine.map_temperatures_c, setting.history.temperatures_c
    return _following_series(
        setting,
        profile,
        of_bodies[warm] - of_bodies[cold],
        of_maps[warm] - of_maps[cold],
        (warm, cold),
        {},
    )


def _following_series(
    setting: Setting,
    profile: Profile,
    series: FloatArray,
    at_maps: FloatArray,
    sensors: tuple[str, ...],
    parameters: dict[str, float | str],
) -> Effect:
    """Let a component follow a series beyond what the maps have of it, late in that variant."""
    if setting.variant == LATE:
        tau = setting.choose_time_constant_min(*LATE_MIN)
        series = low_pass(series, tau)
        parameters["time_constant_min"] = tau
    driver = setting.beyond_maps(
        profile.code, lambda circumstances: circumstances.at(series), at_maps
    )
    return setting.driven(profile, driver, "_per_k", sensors=sensors, parameters=parameters)


def temperature_curvature(setting: Setting) -> Effect:
    """Bend one component's line over temperature: its square, less what the maps have of it."""
    code = setting.choose_component()
    sensor = COMPONENTS[code].sensor
    nodes = setting.machine.map_temperatures_c[sensor]
    middle = float(nodes[nodes.size // 2])
    profile = setting.choose_profile(code)

    def square(circumstances: Circumstances) -> FloatArray:
        return np.square(circumstances.temperature(sensor) - middle)

    driver = setting.beyond_maps(code, square, (nodes - middle) ** 2)
    return setting.driven(
        profile, driver, "_per_k2", sensors=(sensor,), parameters={"about_c": middle}
    )
