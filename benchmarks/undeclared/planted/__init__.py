"""The fourteen families of effects, one file each.

Every file has a `VARIANTS` and a `plant(setting, variant)` that returns an `Effect` of the
wanted amplitude with random component, sensor and parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

from benchmarks.undeclared.effect import Effect
from benchmarks.undeclared.planted import (
    additional_sensor,
    angular,
    backlash,
    drift,
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
)
from benchmarks.undeclared.setting import Setting


class Family(NamedTuple):
    """How effects of one family are planted."""

    variants: tuple[str, ...]
    plant: Callable[[Setting, str], Effect]


FAMILIES: Final = {
    "thermal-lag": Family(thermal_lag.VARIANTS, thermal_lag.plant),
    "other-sensor": Family(other_sensor.VARIANTS, other_sensor.plant),
    "additional-sensor": Family(additional_sensor.VARIANTS, additional_sensor.plant),
    "sensor-gradient": Family(sensor_gradient.VARIANTS, sensor_gradient.plant),
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
}
"""What the service searches, by its own names."""
