"""What the steps of coarse sensors leave in the residuals.

A sensor that reads in whole degrees is off by up to half of one, by about the same amount for as
long as its reading stays. All components that follow it are then off together, each by its own
slope, and that looks like structure.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy import sparse

from app.arrays import FloatArray, SparseArray
from app.effects.kind import NotTested
from app.effects.kinds.sensor_fault import SensorFault
from app.effects.projection import Projection
from app.effects.supposition import left_by_temperatures
from app.thermal.coarse_readings import Coarse, looking_back
from app.thermal.machine import Machine
from app.thermal.temperature_history import TemperatureHistory


def coarse_sensors(machine: Machine, readings: TemperatureHistory) -> dict[str, Coarse]:
    """Look back on the readings of each coarse sensor."""
    found = {}
    for sensor in readings.temperatures_c:
        times_s, temperatures_c = readings.known(sensor)
        one = looking_back(times_s, temperatures_c, machine.sensor(sensor).max_age_s)
        if one is not None:
            found[sensor] = one
    return found


def looked_back(readings: TemperatureHistory, coarse: Mapping[str, Coarse]) -> TemperatureHistory:
    """Give a record as it probably was between the steps of coarse sensors."""
    temperatures_c: dict[str, FloatArray] = dict(readings.temperatures_c)
    for sensor, one in coarse.items():
        values = temperatures_c[sensor].copy()
        values[~np.isnan(values)] = one.temperatures_c
        temperatures_c[sensor] = values
    return TemperatureHistory(readings.times_s, temperatures_c)


def step_columns(
    projection: Projection, readings: TemperatureHistory, coarse: Mapping[str, Coarse]
) -> SparseArray:
    """Say how each row changes if a coarse sensor was off while its reading stayed.

    Returns
    -------
    sparse array, shape (n, s) [the rows' units]
        For one standard error of each stay of each coarse sensor that components follow.
    """
    times_s, n = projection.rows.times_s, len(projection.rows)
    found = [sparse.csr_array((n, 0))]
    for sensor in dict.fromkeys(group.sensor for group in projection.model.groups):
        if sensor not in coarse:
            continue
        read_s, _ = readings.known(sensor)
        one = coarse[sensor]
        stay = one.stay[np.searchsorted((read_s[1:] + read_s[:-1]) / 2.0, times_s)]
        change = left_by_temperatures(projection, {sensor: np.full(n, one.error_k)})
        own, place = np.unique(stay, return_inverse=True)
        at = (np.arange(n), place)
        found.append(sparse.csr_array((np.nan_to_num(change), at), shape=(n, len(own))))
    columns = sparse.csr_array(sparse.hstack(found))
    columns.eliminate_zeros()
    return columns


def read_in_steps(coarse: Mapping[str, Coarse]) -> tuple[NotTested, ...]:
    """Name the coarse sensors, and what that does to figures and tables."""
    return tuple(
        NotTested(
            SensorFault.kind,
            sensor,
            f"reads in steps of {one.step_k:g} K: between two steps its temperature is taken from "
            "when the reading changed, which a live table cannot know; the table is off by what "
            f"up to {one.step_k / 2.0:g} K does",
        )
        for sensor, one in coarse.items()
    )
