"""Adopted effects in a compensation table: its components corrected, and everything said."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from app.compensation.table import (
    Basis,
    CompensationTable,
    ComponentCompensation,
    EffectInTable,
    Sureness,
    group_compensation,
    remarks,
    shortenings,
)
from app.effects.adopted.faulty_sensors import set_faulty_aside
from app.effects.adopted.followed_sensors import ReadMaps, basis_of_maps, read_maps
from app.effects.adopted.held import (
    EFFECTS_ONLY,
    use_until,
    with_held,
)
from app.effects.adopted.live_effects import CorrectedTable, corrected_tables
from app.effects.conditions import Conditions
from app.effects.effect import Effect
from app.effects.kinds.sensor_fault import BIAS, SensorFault
from app.effects.registry import explain
from app.effects.response_driver import Responding
from app.errors import list_names
from app.thermal.compiled_model import CompiledModel
from app.thermal.group import sentences
from app.thermal.group_state import GroupState
from app.thermal.prediction import GRAVITY
from app.thermal.sensor_health import Health, SensorState

NO_MAPS: Final = Basis(None, None, None, None, None, EFFECTS_ONLY)
"""What a component rests on that adopted effects alone give an error."""


def faulty_marked(
    model: CompiledModel,
    effects: Sequence[Effect],
    moment: Conditions,
    sensors: Iterable[SensorState],
) -> list[SensorState]:
    """Mark the sensors that an adopted effect calls faulty and for which others can stand in.

    What is the matter with a sensor takes precedence now: one that is missing stays missing.
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
    moment
        What held when the table holds, faulty sensors' readings included.

    Returns
    -------
    CompensationTable
        `complete` only if every effect could be evaluated, on fresh temperatures, and where it
        was learnt.

    Raises
    ------
    OutsideMaps
        If a component follows another sensor whose temperature the machine's policy does not
        allow.
    """
    aside = set_faulty_aside(model, effects, moment).effects
    live = corrected_tables(model, effects, moment, table.states)
    missing = {m.effect: m.reason for m in live.missing}
    dealt_with = {*aside, *missing}
    reports = [
        _in_table(
            effect,
            missing.get(i, ""),
            [r.sentence for r in live.held if r.effect == i],
            () if i in dealt_with else sureness(effect, moment),
        )
        for i, effect in enumerate(effects)
    ]
    old = [
        f"{reports[i].kind} of {list_names(effect.components)} rests on an old temperature "
        f"of {sensor}"
        for i, effect in enumerate(effects)
        for sensor in effect.sensors
        if sensor in stale and i not in missing
    ]
    tables = live.tables
    read = _read_maps(model, tables, effects, moment)
    by_others = _by_others(table, read)
    shortened = _shortenings(table, tables)
    corrected = [_corrected(c, effects, read.get(c.component.code)) for c in tables]
    outside = [r.sentence for r in (*live.held, *live.unlearnt)]
    is_complete = table.complete_where_it_reaches and not missing and not old
    return table._replace(
        complete=is_complete and not outside and not shortened and not live.refused,
        warnings=[
            *_warnings_of_maps(table, read, by_others),
            *shortened,
            *old,
            *_left_out(reports),
            *outside,
            *(remark.sentence for remark in live.moved),
            *_read_on(effects, moment, dealt_with),
        ],
        corrected=_with_stand_ins(table, effects, aside, corrected),
        effects=reports,
    )


def sureness(effect: Effect, moment: Conditions) -> list[Sureness]:
    """Say how sure a response is at a moment; nothing of other effects."""
    sure = []
    for term in effect.terms:
        if isinstance(term.driver, Responding):
            expected = term.driver.expected(moment)
            parts = (expected.mean, expected.learnt, expected.wander, expected.corrected)
            sure.append(Sureness(term.component, *(float(part[0]) for part in parts)))
    return sure


def _in_table(
    effect: Effect, missing: str, at_edge: Sequence[str], sure: Sequence[Sureness]
) -> EffectInTable:
    return EffectInTable(
        effect.kind,
        effect.components,
        effect.sensors,
        explain(effect),
        missing,
        at_edge,
        effect.learnt_fields,
        use_until(effect),
        sure,
    )


def _read_maps(
    model: CompiledModel,
    tables: Iterable[CorrectedTable],
    effects: Sequence[Effect],
    moment: Conditions,
) -> dict[str, list[ReadMaps]]:
    """Say of components whose sensor an effect exchanges by which sensors their maps are read."""
    by_code = {
        corrected.component.code: read_maps(
            model,
            corrected.origin,
            corrected.component.code,
            [effects[i] for i in corrected.effects],
            moment,
        )
        for corrected in tables
        if corrected.origin is not None
    }
    return {code: read for code, read in by_code.items() if read}


def _by_others(
    table: CompensationTable, read: Mapping[str, Sequence[ReadMaps]]
) -> list[GroupState]:
    """List where components lie by sensors that they are not assigned to."""
    plain = {id(state) for state in table.states}
    return [
        map_read.state
        for maps_read in read.values()
        for map_read in maps_read
        if id(map_read.state) not in plain
    ]


def _warnings_of_maps(
    table: CompensationTable,
    read: Mapping[str, Sequence[ReadMaps]],
    by_others: Sequence[GroupState],
) -> list[str]:
    """Say what is the matter with the maps by the sensors by which they really are read.

    How far the rows reach is said elsewhere (`_shortenings`).
    """
    in_use = {id(map_read.state) for maps_read in read.values() for map_read in maps_read}
    by_assigned = [
        state._replace(group=replace(state.group, members=members))
        for state in table.states
        if (
            members := tuple(
                m
                for m in state.group.members
                if id(state) in in_use or m.component.code not in read
            )
        )
    ]
    outdated = {words for state in table.states for words in shortenings(state)}
    outdated |= set(remarks(table.states)) if read else set()
    if not read:
        return [warning for warning in table.warnings if warning not in outdated]
    return [
        *(warning for warning in table.warnings if warning not in outdated),
        *remarks([*by_assigned, *by_others]),
    ]


def _shortenings(table: CompensationTable, tables: Sequence[CorrectedTable]) -> list[str]:
    """Say which components end earlier than other maps of theirs, by the maps that enter."""
    codes = {one.component.code for one in tables}
    plain = [words for state in table.states for words in shortenings(state, codes)]
    corrected = [
        (code, one.maps.shortened[code])
        for one in tables
        if one.maps is not None and (code := one.component.code) in one.maps.shortened
    ]
    return [*plain, *sentences(corrected)]


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
    how = {BIAS: "the bias is taken off until the sensor is repaired"}
    return [
        f"{explain(effect)}: "
        f"{how.get(effect.variant, 'no other sensor can stand in, so it is used as it is')}"
        for i, effect in enumerate(effects)
        if effect.kind == SensorFault.kind and i not in dealt_with
        if any(np.any(term.driver.at(moment)) for term in effect.terms)
    ]


def _corrected(
    table: CorrectedTable, effects: Sequence[Effect], read: Sequence[ReadMaps] | None
) -> ComponentCompensation:
    if read:
        basis = basis_of_maps(read)
    else:
        basis = NO_MAPS if table.origin is None else Basis.of(table.origin)
    if table.status is not None:
        basis = replace(basis, status=max(basis.status, table.status, key=GRAVITY.index))
    if table.is_held:
        basis = replace(basis, status=with_held(basis.status))
    return ComponentCompensation(
        component=table.component,
        positions_mm=table.positions_mm,
        errors=table.errors,
        backward_errors=table.backward_errors,
        standard_errors=None,
        backward_standard_errors=None,
        basis=basis,
        effects=tuple(dict.fromkeys(effects[i].kind for i in table.effects)),
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
    by_code = {entry.component.code: entry for entry in plain if entry.component.code in faults}
    by_code |= {entry.component.code: entry for entry in corrected}
    return [
        replace(entry, effects=(SensorFault.kind, *entry.effects)) if code in faults else entry
        for code, entry in by_code.items()
    ]
