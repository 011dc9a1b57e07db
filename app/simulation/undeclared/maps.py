"""The error maps: thermal states, measurement errors, HTTP bodies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import timedelta

import numpy as np

from app.simulation.undeclared.base_machine import BaseMachine, positions_of
from app.simulation.undeclared.components import ASSIGNED_SENSORS, CODES, COMPONENTS, FloatArray
from app.simulation.undeclared.conditions import Conditions
from app.simulation.undeclared.error_tables import ErrorTable
from app.simulation.undeclared.history import SENSORS, History

MARGIN_C = 0.5
"""The maps' temperatures reach so far beyond the campaign's [°C]."""


@dataclass(frozen=True)
class MeasuredMaps:
    """What was measured: a table for each component, its rows the maps.

    Parameters
    ----------
    tables : mapping of component to ErrorTable
        With their measurement errors.
    temperatures_c : mapping of sensor to ndarray, shape (M,) [°C]
        Of all sensors in the maps' thermal states.
    """

    tables: Mapping[str, ErrorTable]
    temperatures_c: Mapping[str, FloatArray]

    def bodies(self, conditions: Conditions) -> list[dict[str, object]]:
        """Write the maps as the service takes them."""
        count = next(iter(self.temperatures_c.values())).size
        first_day = conditions.start - timedelta(days=count + 7)
        return [
            {
                "label": f"State {row + 1}",
                "measured_at": f"{first_day + timedelta(days=row):%Y-%m-%dT12:00:00Z}",
                "temperatures_c": {s: float(t[row]) for s, t in self.temperatures_c.items()},
                "components": [
                    _component_body(code, table, row, conditions)
                    for code, table in self.tables.items()
                ],
                "instrument": "simulated",
            }
            for row in range(count)
        ]


def thermal_states(
    rng: np.random.Generator, history: History, conditions: Conditions
) -> dict[str, FloatArray]:
    """Choose the sensors' temperatures in the maps: from the coldest to the warmest of all.

    Parameters
    ----------
    history
        Whose temperatures are to lie inside the maps.

    Returns
    -------
    dict of sensor to ndarray, shape (M,) [°C]
        Increasing, in tenths of a degree.
    """
    shares = np.linspace(0.0, 1.0, conditions.maps)
    apart = 1.0 / (conditions.maps - 1)
    shares[1:-1] += apart * rng.uniform(-0.16, 0.16, conditions.maps - 2)
    states = {}
    for sensor in SENSORS:
        seen = history.since_first_reading(history.temperatures_c[sensor])
        low, high = seen.min() - MARGIN_C, seen.max() + MARGIN_C
        inner = np.zeros(conditions.maps)
        inner[1:-1] = apart * rng.uniform(-0.06, 0.06, conditions.maps - 2)
        states[sensor] = np.round(low + (shares + inner) * (high - low), 1)
        states[sensor][0] = np.floor(low * 10) / 10
        states[sensor][-1] = np.ceil(high * 10) / 10
    return states


def measure_maps(
    rng: np.random.Generator, machine: BaseMachine, conditions: Conditions
) -> MeasuredMaps:
    """Measure all components in all thermal states.

    Parameters
    ----------
    rng
        Source of chance; the errors drawn for a component do not depend on the others.
    machine
        Without its undeclared effect, or what of it the maps do not contain.
    """
    count = conditions.maps
    errors = {
        code: conditions.map_error_um * rng.standard_normal((count, positions_of(code).size))
        for code in CODES
    }
    tables = {}
    for code in machine.measured_codes:
        table = machine.table(code)
        tables[code] = table.with_errors(table.errors + errors[code])
    return MeasuredMaps(tables, machine.map_temperatures_c)


def sensor_bodies(conditions: Conditions) -> list[dict[str, object]]:
    """Describe the sensors as the service takes them; those that components follow first."""
    ordered = [*ASSIGNED_SENSORS, *(s for s in SENSORS if s not in ASSIGNED_SENSORS)]
    return [
        {
            "name": sensor,
            "min_c": -10.0,
            "max_c": 100.0,
            "max_age_s": 180.0,
            "resolution_c": max(conditions.quantum_c, 0.01),
        }
        for sensor in ordered
    ]


def _component_body(
    code: str, table: ErrorTable, row: int, conditions: Conditions
) -> dict[str, object]:
    unit = COMPONENTS[code].unit
    errors = [float(e) for e in table.errors[row].round(6)]
    if COMPONENTS[code].axis is None:
        body: dict[str, object] = {"component": code, f"value_{unit}": errors[0]}
        if conditions.state_standard_errors:
            body[f"standard_error_{unit}"] = conditions.map_error_um
        return body
    body = {
        "component": code,
        "positions_mm": table.positions_mm.tolist(),
        f"errors_{unit}": errors,
    }
    if conditions.state_standard_errors:
        body[f"standard_errors_{unit}"] = [conditions.map_error_um] * len(errors)
    return body
