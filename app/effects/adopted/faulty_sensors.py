"""Sensors that an adopted effect calls faulty: set aside where another one can stand in.

A bias is corrected as it was found: the tables are read at the temperature without it. A sensor
that stuck or spikes tells no temperature: a stand-in serves, and the effect adds nothing. A
stand-in that serves because a biased sensor is silent has no bias either.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.effects.conditions import Conditions
from app.effects.effect import Effect
from app.effects.kinds.sensor_fault import BIAS, SensorFault
from app.thermal.compiled_model import CompiledModel


@dataclass(frozen=True, eq=False)
class SetAside:
    """Which faulty sensors are replaced, and when.

    Parameters
    ----------
    effects : mapping of number to ndarray, shape (n,)
        Number of the effect to where a stand-in serves for its sensor.
    conditions
        What the tables are to be read by: there without the faulty sensor's temperature.
    """

    effects: Mapping[int, BoolArray]
    conditions: Conditions


def set_faulty_aside(
    model: CompiledModel, effects: Sequence[Effect], conditions: Conditions
) -> SetAside:
    """Find where stand-ins serve for sensors that read wrong."""
    lacking: dict[int, BoolArray] = {}
    temperatures = dict(conditions.temperatures_c)
    for number, effect in enumerate(effects):
        if effect.kind != SensorFault.kind:
            continue
        sensor = effect.sensors[0]
        there = _is_active(effect, conditions) & _can_be_replaced(
            model, sensor, temperatures, len(conditions)
        )
        if effect.variant == BIAS:
            there &= np.isnan(conditions.temperature(sensor))
        if there.any():
            lacking[number] = there
            if sensor in temperatures:
                temperatures[sensor] = np.where(there, np.nan, temperatures[sensor])
    return SetAside(
        lacking, replace(conditions, temperatures_c=temperatures) if lacking else conditions
    )


def _is_active(effect: Effect, conditions: Conditions) -> BoolArray:
    active: BoolArray = np.any([term.driver.at(conditions) != 0.0 for term in effect.terms], axis=0)
    return active


def _can_be_replaced(
    model: CompiledModel, sensor: str, temperatures_c: Mapping[str, FloatArray], n: int
) -> BoolArray:
    """Say at which of n moments all components of a sensor have another with a temperature."""
    replaceable = np.ones(n, dtype=np.bool_)
    for group in model.groups:
        if group.sensor == sensor:
            others = [temperatures_c.get(scale.sensor) for scale in group.scales[1:]]
            present = [~np.isnan(t) for t in others if t is not None]
            replaceable &= np.any(present, axis=0) if present else False
    return replaceable
