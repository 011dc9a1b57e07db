"""The families of effects, one file each.

Every file has a `VARIANTS` and a `plant(setting, variant)` that returns an `Effect` of the
wanted amplitude with random component, sensor and parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

from app.simulation.undeclared.effect import Effect
from app.simulation.undeclared.planted import (
    additional_sensor,
    ageing_sensor,
    angular,
    backlash,
    clock_offset,
    detached_sensor,
    drift,
    exchanged_sensors,
    late_sensor,
    map_factor,
    map_temperature,
    mirrored_axis,
    nonrigid_slope,
    other_sensor,
    outdated_map,
    periodic,
    sensor_fault,
    sensor_gradient,
    state_variable,
    step,
    temperature_curvature,
    thermal_lag,
    tool_length,
    wrong_map,
)
from app.simulation.undeclared.setting import Setting


class Family(NamedTuple):
    """How effects of one family are planted; some variants only where they are asked for."""

    variants: tuple[str, ...]
    plant: Callable[[Setting, str], Effect]
    only_asked_for: tuple[str, ...] = ()


FAMILIES: Final = {
    "thermal-lag": Family(thermal_lag.VARIANTS, thermal_lag.plant),
    "other-sensor": Family(other_sensor.VARIANTS, other_sensor.plant),
    "additional-sensor": Family(
        additional_sensor.VARIANTS, additional_sensor.plant, additional_sensor.ONLY_ASKED_FOR
    ),
    "sensor-gradient": Family(
        sensor_gradient.VARIANTS, sensor_gradient.plant, sensor_gradient.ONLY_ASKED_FOR
    ),
    "temperature-curvature": Family(temperature_curvature.VARIANTS, temperature_curvature.plant),
    "state-variable": Family(state_variable.VARIANTS, state_variable.plant),
    "backlash": Family(backlash.VARIANTS, backlash.plant),
    "periodic": Family(periodic.VARIANTS, periodic.plant),
    "angular": Family(angular.VARIANTS, angular.plant),
    "nonrigid-slope": Family(nonrigid_slope.VARIANTS, nonrigid_slope.plant),
    "drift": Family(drift.VARIANTS, drift.plant),
    "step": Family(step.VARIANTS, step.plant),
    "sensor-fault": Family(sensor_fault.VARIANTS, sensor_fault.plant),
    "outdated-map": Family(outdated_map.VARIANTS, outdated_map.plant),
    "exchanged-sensors": Family(exchanged_sensors.VARIANTS, exchanged_sensors.plant),
    "map-factor": Family(map_factor.VARIANTS, map_factor.plant),
    "map-temperature": Family(map_temperature.VARIANTS, map_temperature.plant),
    "clock-offset": Family(clock_offset.VARIANTS, clock_offset.plant),
    "mirrored-axis": Family(mirrored_axis.VARIANTS, mirrored_axis.plant),
    "late-sensor": Family(late_sensor.VARIANTS, late_sensor.plant),
    "ageing-sensor": Family(ageing_sensor.VARIANTS, ageing_sensor.plant),
    "detached-sensor": Family(detached_sensor.VARIANTS, detached_sensor.plant),
    "tool-length": Family(tool_length.VARIANTS, tool_length.plant),
    "wrong-map": Family(wrong_map.VARIANTS, wrong_map.plant),
}
"""What the service searches, by its own names: what the machine does, then people's mistakes."""
