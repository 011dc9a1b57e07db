"""A model whose tables do not change with temperature, for data that came without any.

Two maps with the same tables stand at two room temperatures, and the room stays between
them: what the table lacks is then the residual, and no temperature explains it.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime

import numpy as np

from app.geometry.chain import Chain
from app.thermal.compile_model import compile_model
from app.thermal.compiled_model import CompiledModel
from app.thermal.error_map import ComponentTable, ErrorMap
from app.thermal.machine import Machine, Sensor, Travel, sensors_by_name
from app.thermal.temperature_history import TemperatureHistory

ROOM = "room"
ROOM_C = 20.0
DAY_S = 86400.0


def constant_model(
    name: str,
    axes: Mapping[str, Travel],
    tables: Mapping[str, ComponentTable],
    start_s: float,
    repeatability_um: float,
) -> tuple[CompiledModel, list[ErrorMap], TemperatureHistory]:
    """Compile the tables, and write a day of the same temperature.

    Parameters
    ----------
    name
        The machine's.
    axes
        Its travels.
    tables
        Component to table.
    start_s
        When the observations begin [s].
    repeatability_um
        Of the tables' measurement [µm].
    """
    machine = Machine(
        id=name,
        name=name,
        chain=Chain.parse("XYFZ"),
        axes=axes,
        sensors=sensors_by_name([Sensor(ROOM, max_age_s=2.0 * DAY_S, stuck_after_s=None)]),
    )
    maps = [
        ErrorMap(
            label=f"{name} at {room_c:g} °C",
            measured_at=datetime.fromtimestamp(start_s, UTC),
            temperatures_c={ROOM: room_c},
            tables=tables,
            repeatability_um=repeatability_um,
        )
        for room_c in (ROOM_C - 5.0, ROOM_C + 5.0)
    ]
    times = np.array([start_s - DAY_S / 2.0, start_s + DAY_S / 2.0])
    readings = TemperatureHistory(times, {ROOM: np.full(2, ROOM_C)})
    return compile_model(machine, maps, dict.fromkeys(tables, ROOM)), maps, readings
