"""Sensors that left their neighbours, in an analysis: kept out of the search, and named.

A failed sensor that no component follows does the tables no harm, but it is a driver like
any other to the search, and its failure imitates whatever else began on that day.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from app.effects.kind import NotTested
from app.effects.kinds.sensor_fault import SensorFault
from app.thermal.compiled_model import CompiledModel
from app.thermal.doubtful_sensors import DoubtfulSensor, doubtful_sensors, without_doubtful
from app.thermal.sensor_health import believed, without_stuck
from app.thermal.temperature_history import TemperatureHistory
from app.units import date_text


def trusted_readings(model: CompiledModel, readings: TemperatureHistory) -> TemperatureHistory:
    """Leave out of a record what no search may rely on.

    Parameters
    ----------
    model
        The compiled model: a sensor that its components follow is not left out, as the
        effect `sensor-fault` says what its failure does to the tables.

    Returns
    -------
    TemperatureHistory
        The same times, NaN where a value was not to be believed.
    """
    trusted = _looking_back(model, readings)
    followed = _followed(model)
    return without_doubtful(
        trusted,
        [
            doubtful_sensor
            for doubtful_sensor in doubtful_sensors(trusted)
            if doubtful_sensor.sensor not in followed
        ],
    )


def doubts(model: CompiledModel, readings: TemperatureHistory) -> tuple[NotTested, ...]:
    """Name the sensors that left their neighbours, and what became of their readings."""
    doubtful = doubtful_sensors(_looking_back(model, readings))
    return tuple(
        NotTested(SensorFault.kind, doubt.sensor, _reason(doubt, doubt.sensor in _followed(model)))
        for doubt in doubtful
    )


def comparisons(doubted: Sequence[NotTested]) -> tuple[str, ...]:
    """Say what to do about doubtful sensors."""
    return tuple(
        f"Compare {doubt.on} with a calibrated thermometer placed beside it: it {doubt.reason}."
        for doubt in doubted
    )


def _looking_back(model: CompiledModel, readings: TemperatureHistory) -> TemperatureHistory:
    """Leave out what could not be believed at its time, or proved later to have been stuck."""
    trusted, without_frozen = (
        judge(model.machine, readings) for judge in (believed, without_stuck)
    )
    cleaned = {
        name: np.where(np.isnan(without_frozen.temperatures_c[name]), np.nan, values)
        for name, values in trusted.temperatures_c.items()
    }
    return TemperatureHistory(trusted.times_s, cleaned)


def _followed(model: CompiledModel) -> set[str]:
    return {scale.sensor for group in model.groups for scale in group.scales}


def _reason(sensor: DoubtfulSensor, is_followed: bool) -> str:
    used = (
        "components follow it, and its readings are used as they are"
        if is_followed
        else "no component follows it, and its readings since then are not used"
    )
    return (
        f"departed from its neighbours by {sensor.off_by_k:+.1f} K on {date_text(sensor.since_s)}, "
        f"having stayed within {sensor.usual_k:.1f} K of them before; {used}"
    )
