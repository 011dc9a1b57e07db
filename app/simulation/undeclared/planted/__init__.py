"""The families of effects that the service searches: what the machine does, people's mistakes.

Each is a function that makes an `Effect` of the wanted amplitude with random component, sensor and
parameters.
"""

from __future__ import annotations

from typing import Final

from app.simulation.undeclared.planted import mistakes, motion, sensors, structure
from app.simulation.undeclared.setting import Family

FAMILIES: Final = {
    "thermal-lag": Family(structure.thermal_lag, "component", "sensor"),
    "other-sensor": Family(structure.other_sensor, "component"),
    "additional-sensor": Family(
        structure.additional_sensor,
        "component",
        only_asked_for=(structure.EXPANSION, structure.LATE),
    ),
    "sensor-gradient": Family(
        structure.sensor_gradient, "component", only_asked_for=(structure.LATE,)
    ),
    "temperature-curvature": Family(structure.temperature_curvature, "component"),
    "state-variable": Family(
        motion.state_variable,
        *motion.STATES,
        *(f"{state}-lagged" for state in motion.STATES if state != "payload"),
    ),
    "backlash": Family(motion.backlash, "constant", "along-axis"),
    "periodic": Family(motion.periodic, "single", "harmonic"),
    "angular": Family(motion.angular, *motion.ROTATIONS_OF),
    "nonrigid-slope": Family(motion.nonrigid_slope, "linear", "angular"),
    "drift": Family(motion.drift, "component"),
    "step": Family(motion.step, "component", "squareness"),
    "sensor-fault": Family(sensors.sensor_fault, "bias", "stuck", "spikes"),
    "outdated-map": Family(motion.outdated_map, "shift", "slope", "profile"),
    "exchanged-sensors": Family(sensors.exchanged_sensors, "both-followed", "one-followed"),
    "map-factor": Family(
        mistakes.map_factor,
        *("sign", "sign-in-one-map", "inches", "tenfold-in-one-map", "unit-of-one-map"),
    ),
    "map-temperature": Family(mistakes.map_temperature, "inner", "outermost"),
    "clock-offset": Family(mistakes.clock_offset, "an-hour-early", "an-hour-late", "some-minutes"),
    "mirrored-axis": Family(mistakes.mirrored_axis, "axis", "one-line"),
    "late-sensor": Family(sensors.late_sensor, "by-a-buffer"),
    "ageing-sensor": Family(sensors.ageing_sensor, "drifting"),
    "detached-sensor": Family(sensors.detached_sensor, "in-the-room"),
    "tool-length": Family(mistakes.tool_length, "one-tool", "every-tool"),
    "wrong-map": Family(mistakes.wrong_map, "shift", "slope", "profile"),
}
"""By the service's own names."""
