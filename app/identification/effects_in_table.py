"""Adopted effects in a compensation table: its components corrected, and everything said."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace

import numpy as np

from app.compensation.table import (
    CompensationTable,
    ComponentCompensation,
    EffectInTable,
    group_compensation,
)
from app.errors import list_names
from app.identification.conditions import Conditions
from app.identification.effects.effect import Effect
from app.identification.effects.registry import explain
from app.identification.effects.sensor_fault import BIAS, SensorFault
from app.identification.faulty_sensors import set_faulty_aside
from app.identification.live_effects import CorrectedTable, corrected_tables, corrections
from app.thermal.compiled_model import CompiledModel
from app.thermal.sensor_health import Health, SensorState


def faulty_marked(
    model: CompiledModel,
    effects: Sequence[Effect],
    moment: Conditions,
    sensors: Iterable[SensorState],
) -> list[SensorState]:
    """Mark the sensors that an adopted effect calls faulty and for which others can stand in.

    What is the matter with a sensor now goes before: one that is missing stays missing.

    Parameters
    ----------
    model, effects
        The compiled model and its adopted effects.
    moment
        Conditions of one moment.
    sensors
        The sensors' states then.

    Returns
    -------
    list of SensorState
    """
    numbers = set_faulty_aside(model, effects, moment).effects
    why = {effects[number].sensors[0]: explain(effects[number]) for number in numbers}
    return [
        state._replace(health=Health.FAULTY, detail=why[state.sensor])
        if state.sensor in why and state.health in (Health.OK, Health.STALE)
        else state
        for state in sensors
    ]


def add_effects(
    table: CompensationTable,
    model: CompiledModel,
    effects: Sequence[Effect],
    moment: Conditions,
    stale: Collection[str] = (),
) -> CompensationTable:
    """Add adopted effects to a table.

    Parameters
    ----------
    table
        The table of the maps alone, faulty sensors set aside (`faulty_marked`).
    model, effects
        The compiled model and its adopted effects.
    moment
        What held when the table holds, faulty sensors' readings included.
    stale
        Sensors whose temperature is old.

    Returns
    -------
    CompensationTable
        `complete` only if every effect could be evaluated, on fresh temperatures.
    """
    aside = set_faulty_aside(model, effects, moment).effects
    found = corrections(model, effects, moment)
    missing = {m.effect: m.reason for m in found.missing}
    dealt_with = {*aside, *missing}
    said = [_in_table(effect, missing.get(i, "")) for i, effect in enumerate(effects)]
    old = [
        f"{said[i].kind} of {list_names(effect.components)} rests on an old temperature of {sensor}"
        for i, effect in enumerate(effects)
        for sensor in effect.sensors
        if sensor in stale and i not in missing
    ]
    corrected = [
        _corrected(c, effects)
        for c in corrected_tables(table.states, found.corrections)
        if c.effects
    ]
    return replace(
        table,
        complete=table.complete and not missing and not old,
        warnings=[*table.warnings, *old, *_left_out(said), *_read_on(effects, moment, dealt_with)],
        corrected=_with_stand_ins(table, effects, aside, corrected),
        effects=said,
    )


def _in_table(effect: Effect, missing: str) -> EffectInTable:
    return EffectInTable(effect.kind, effect.components, effect.sensors, explain(effect), missing)


def _left_out(effects: Iterable[EffectInTable]) -> list[str]:
    return [
        f"{effect.kind} of {list_names(effect.components)} is not in the table: {effect.missing}"
        for effect in effects
        if effect.missing
    ]


def _read_on(
    effects: Sequence[Effect], moment: Conditions, dealt_with: Collection[int]
) -> list[str]:
    """Say which faulty sensors are read on, and how."""
    how = {BIAS: "the bias is taken off"}
    return [
        f"{explain(effect)}: no other sensor can stand in, "
        f"{how.get(effect.variant, 'it is read as it is')}"
        for i, effect in enumerate(effects)
        if effect.kind == SensorFault.kind and i not in dealt_with
        if any(np.any(term.driver.at(moment)) for term in effect.terms)
    ]


def _corrected(found: CorrectedTable, effects: Sequence[Effect]) -> ComponentCompensation:
    return ComponentCompensation(
        component=found.component,
        positions_mm=found.positions_mm,
        errors=found.errors,
        backward_errors=found.backward_errors,
        standard_errors=None,
        backward_standard_errors=None,
        origin=found.origin,
        effects=tuple(dict.fromkeys(effects[i].kind for i in found.effects)),
    )


def _with_stand_ins(
    table: CompensationTable,
    effects: Sequence[Effect],
    aside: Collection[int],
    corrected: Sequence[ComponentCompensation],
) -> list[ComponentCompensation]:
    """Name the fault also at the components that a stand-in serves."""
    if not aside:
        return list(corrected)
    faults = {code for i in aside for code in effects[i].components}
    plain = [entry for state in table.states for entry in group_compensation(state)]
    found = {entry.component.code: entry for entry in plain if entry.component.code in faults}
    found |= {entry.component.code: entry for entry in corrected}
    return [
        replace(entry, effects=(SensorFault.kind, *entry.effects)) if code in faults else entry
        for code, entry in found.items()
    ]
