"""What a model without effects says: the measured maps at the sensors' readings.

The rule of C. Wang, 8.105–8.107, as the domain's page states it, written here once more so that
the service is not measured by its own code: linear between the two maps around the assigned
sensor's temperature, the nearest map outside, linear between positions.
"""

from __future__ import annotations

import numpy as np

from app.simulation.undeclared.base_machine import CHAIN
from app.simulation.undeclared.components import COMPONENTS, FloatArray
from app.simulation.undeclared.error_tables import ErrorTable
from app.simulation.undeclared.history import History
from app.simulation.undeclared.kinematics import volumetric_error
from app.simulation.undeclared.maps import MeasuredMaps
from app.simulation.undeclared.observations import (
    Circumstances,
    ErrorFunction,
    Observations,
    evaluate,
)
from app.simulation.undeclared.sensors import SensorRecord


def predict(
    maps: MeasuredMaps, record: SensorRecord, observations: Observations, history: History
) -> FloatArray:
    """Predict the observed values from maps and readings.

    Parameters
    ----------
    maps, record
        With their measurement errors.
    observations
        What is to be predicted; no component that the maps lack.
    history
        Unused by the maps, but `evaluate` asks for it.

    Returns
    -------
    ndarray, shape (m,)
    """
    errors = {code: _of_map(code, table, record) for code, table in maps.tables.items()}
    return evaluate(errors, observations, history)


def _of_map(code: str, table: ErrorTable, record: SensorRecord) -> ErrorFunction:
    component = COMPONENTS[code]

    def error(circumstances: Circumstances) -> FloatArray:
        temperature = record.at(component.sensor, circumstances.time_min)
        return table.at(circumstances.point_mm[:, component.axis or 0], temperature, clamp=True)

    return error


def entry_weights(
    maps: MeasuredMaps, record: SensorRecord, observations: Observations
) -> FloatArray:
    """Say how each value of the prediction depends on each entry of the maps.

    Returns
    -------
    ndarray, shape (m, entries)
        Derivatives; the entries of the components' tables one after another.
    """
    rows = observations.of_value
    by_entry = np.zeros((rows.size, sum(table.errors.size for table in maps.tables.values())))
    first = 0
    for code, table in maps.tables.items():
        component = COMPONENTS[code]
        temperature = record.at(component.sensor, observations.time_min)
        along = observations.point_mm[:, component.axis or 0]
        entries, weights = table.weights(along, temperature, clamp=True)
        lever = _lever(code, observations)
        for corner in range(entries.shape[1]):
            places = first + entries[rows, corner]
            # Two corners are one entry where the table has a single position.
            np.add.at(by_entry, (np.arange(rows.size), places), lever * weights[rows, corner])
        first += table.errors.size
    return by_entry


def _lever(code: str, observations: Observations) -> FloatArray:
    """What one unit of a component makes of each value: shape (m,)."""
    unit = np.zeros((len(observations), 3))
    unit[observations.of(code), 0] = 1.0
    points = observations[observations.is_point]
    unit[observations.is_point] = volumetric_error(
        CHAIN, {code: np.ones(len(points))}, points.point_mm, points.tool_mm
    )
    return unit[observations.of_value, np.maximum(observations.coordinate, 0)]
