"""What coarse and noisy sensors leave in the residuals.

A sensor that reads in whole degrees is off by up to half of one, by about the same amount for as
long as its reading stays; one whose readings scatter is off by another amount each time. All
components that follow it are then off together, each by its own slope, and that looks like
structure: readings taken from halfway between two of them scatter less, and pass for another
clock or a lag.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from scipy import sparse

from app.arrays import FloatArray, SparseArray
from app.effects.driver import Always
from app.effects.kind import NotTested
from app.effects.kinds.sensor_fault import SensorFault
from app.effects.projection import Projection, sum_of_terms
from app.effects.shape import Exchange
from app.effects.supposition import left_by_temperatures
from app.effects.term import Term
from app.thermal.coarse_readings import Coarse, looking_back
from app.thermal.machine import Machine
from app.thermal.noisy_readings import Noisy, without_noise
from app.thermal.temperature_history import TemperatureHistory

Inexact: TypeAlias = Coarse | Noisy
"""A sensor's readings, looking back."""


def inexact_sensors(machine: Machine, readings: TemperatureHistory) -> dict[str, Inexact]:
    """Look back on the readings of each coarse or noisy sensor."""
    by_sensor: dict[str, Inexact] = {}
    for sensor in readings.temperatures_c:
        times_s, temperatures_c = readings.series(sensor)
        max_gap_s = machine.sensor(sensor).max_age_s
        inexactness = looking_back(times_s, temperatures_c, max_gap_s) or without_noise(
            times_s, temperatures_c, max_gap_s
        )
        if inexactness is not None:
            by_sensor[sensor] = inexactness
    return by_sensor


def looked_back(readings: TemperatureHistory, inexact: Mapping[str, Inexact]) -> TemperatureHistory:
    """Give a record as it probably was, without the steps and the scatter of its sensors."""
    temperatures_c: dict[str, FloatArray] = dict(readings.temperatures_c)
    for sensor, inexactness in inexact.items():
        values = temperatures_c[sensor].copy()
        values[~np.isnan(values)] = inexactness.temperatures_c
        temperatures_c[sensor] = values
    return TemperatureHistory(readings.times_s, temperatures_c)


def error_columns(
    projection: Projection, readings: TemperatureHistory, inexact: Mapping[str, Inexact]
) -> SparseArray:
    """Say how each row changes if a temperature is off: one that was read, or that a map states.

    Returns
    -------
    sparse array, shape (n, s) [the rows' units]
        For one standard error of each.
    """
    columns = [
        reading_error_columns(projection, readings, inexact),
        map_temperature_columns(projection, inexact),
    ]
    return sparse.csr_array(sparse.hstack(columns))


def map_temperature_columns(projection: Projection, inexact: Mapping[str, Inexact]) -> SparseArray:
    """Say how each row changes if the temperature that a map states is off by its rounding.

    All components that follow the sensor are off together (JCGM 100:2008, F.2.2.1).

    Returns
    -------
    sparse array, shape (n, s) [the rows' units]
        For one standard error of each map's temperature by each sensor that components follow.
    """
    model, columns = projection.model, [sparse.csr_array((len(projection.rows), 0))]
    for sensor in dict.fromkeys(group.sensor for group in model.groups):
        inexactness = inexact.get(sensor)
        step_k = inexactness.step_k if isinstance(inexactness, Coarse) else 0.0
        error_k = max(model.machine.sensor(sensor).resolution_c, step_k) / np.sqrt(12.0)
        terms: dict[str, list[Term]] = defaultdict(list)
        for group in (group for group in model.groups if group.sensor == sensor):
            scale = group.scales[0]
            labels = [group.labels[row] for row in scale.rows]
            stated_c = dict(zip(labels, scale.temperatures_c, strict=True))
            for label in labels:
                off = Exchange.of(sensor, {**stated_c, label: stated_c[label] + error_k})
                terms[label] += [Term(code, Always(), off) for code in group.codes]
        for of_map in terms.values():
            change = np.nan_to_num(sum_of_terms(projection, of_map))
            columns.append(sparse.csr_array(change[:, None]))
    return sparse.csr_array(sparse.hstack(columns))


def reading_error_columns(
    projection: Projection, readings: TemperatureHistory, inexact: Mapping[str, Inexact]
) -> SparseArray:
    """Say how each row changes if a sensor was off for a while.

    Returns
    -------
    sparse array, shape (n, s) [the rows' units]
        For one standard error of each stay of a coarse sensor, or stretch of a noisy one, that
        components follow.
    """
    times_s, n = projection.rows.times_s, len(projection.rows)
    blocks = [sparse.csr_array((n, 0))]
    for sensor in dict.fromkeys(group.sensor for group in projection.model.groups):
        if sensor not in inexact:
            continue
        read_s, _ = readings.series(sensor)
        inexactness = inexact[sensor]
        # The stay of the reading that is nearest in time.
        stay = inexactness.stay[np.searchsorted((read_s[1:] + read_s[:-1]) / 2.0, times_s)]
        change = left_by_temperatures(projection, {sensor: np.full(n, inexactness.error_k)})
        stays, place = np.unique(stay, return_inverse=True)
        at = (np.arange(n), place)
        blocks.append(sparse.csr_array((np.nan_to_num(change), at), shape=(n, len(stays))))
    columns = sparse.csr_array(sparse.hstack(blocks))
    columns.eliminate_zeros()
    return columns


def read_inexactly(inexact: Mapping[str, Inexact]) -> tuple[NotTested, ...]:
    """Name the coarse and noisy sensors, and what that does to figures and tables."""
    return tuple(
        NotTested(SensorFault.kind, sensor, _inexactness(inexactness))
        for sensor, inexactness in inexact.items()
    )


def _inexactness(inexactness: Inexact) -> str:
    if isinstance(inexactness, Coarse):
        return (
            f"reads in steps of {inexactness.step_k:g} K: between two steps its temperature is "
            "taken from "
            "when the reading changed, which a live table cannot know; the table is off by what "
            f"up to {inexactness.step_k / 2.0:g} K does"
        )
    return (
        f"scatters by {inexactness.scatter_k:.2g} K from reading to reading: its temperature is "
        "taken from "
        "the readings before and after, which a live table cannot know; the table scatters by "
        f"what {inexactness.scatter_k:.2g} K does"
    )
