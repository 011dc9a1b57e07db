"""Adopted effects in the live tables: each component's row at one moment.

Effects that read the maps at another temperature change how much of each map enters; the row is
then made of those maps that really enter, as a plain one is. Other effects add to it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from app.arrays import FloatArray
from app.effects.adopted.faulty_sensors import set_faulty_aside
from app.effects.adopted.held import (
    NO_NUMBER,
    NOT_COMMON,
    Missing,
    OutsideRange,
    ReadBeyondMaps,
    Remark,
    beyond_maps_sentences,
    conditions_beyond,
    held_sentence,
    positions_beyond,
    read_beyond_maps,
    unknown_range,
)
from app.effects.campaign_view import travel_of
from app.effects.conditions import Conditions
from app.effects.effect import Effect
from app.effects.map_tables import MapReading
from app.effects.shape import Places
from app.effects.term import Term
from app.effects.valid import Valid
from app.geometry.axis_table import CLOSEST_MM
from app.geometry.components import COMPONENTS, ORDER, Component
from app.thermal.compiled_model import CompiledModel
from app.thermal.group import Group, MapsInUse, Member
from app.thermal.group_state import GroupState
from app.thermal.map_weights import added
from app.thermal.prediction import GRAVITY


@dataclass(frozen=True, eq=False)
class CorrectedTable:
    """One component's errors with its effects.

    Parameters
    ----------
    positions_mm : ndarray, shape (k,) [mm]
        Inside what all maps that enter cover, their positions and those that the effects need.
    errors : ndarray, shape (k,), or (1,) without argument [the component's unit]
        Actual minus nominal.
    backward_errors : ndarray, same shape, or None
        The same for positions approached in the negative direction, where that differs.
    origin
        The group's state without effects; None for a component that no map has.
    maps
        The maps that enter; None where none does.
    is_held
        Whether any of the effects is held at the edge of where it was learnt.
    status
        The gravest of the temperatures at which effects read the maps; None where none does.
    """

    component: Component
    positions_mm: FloatArray
    errors: FloatArray
    backward_errors: FloatArray | None
    effects: tuple[int, ...]
    origin: GroupState | None
    maps: MapsInUse | None = None
    is_held: bool = False
    status: str | None = None


@dataclass(frozen=True, eq=False)
class LiveEffects:
    """All components with effects at one moment, what is missing, and what is to be said.

    `missing` are the effects that lack something; `held` says why some are held;
    `unlearnt` are those that take part although nobody has learnt them here, or it is not known
    where they were learnt; `moved` says which read the maps outside of them, and `refused` which
    would not be allowed a table there.
    """

    tables: tuple[CorrectedTable, ...]
    missing: tuple[Missing, ...]
    held: tuple[Remark, ...] = ()
    unlearnt: tuple[Remark, ...] = ()
    moved: tuple[Remark, ...] = ()
    refused: frozenset[int] = frozenset()


def corrected_tables(
    model: CompiledModel,
    effects: Sequence[Effect],
    moment: Conditions,
    states: Iterable[GroupState] = (),
) -> LiveEffects:
    """Make the rows of all components that effects change at one moment.

    Parameters
    ----------
    effects
        The adopted effects, numbered by their order.
    moment
        Conditions of one moment (`Conditions.of_moment`), faulty sensors' readings included.
    states
        What `CompiledModel.errors_at` found for `SetAside.conditions`; of a component that is
        not in them the row is what the effects add.

    Returns
    -------
    LiveEffects
        An effect that lacks its condition is left out entirely, with the reason.
    """
    missing: list[Missing] = []
    terms: dict[str, list[tuple[int, Term]]] = defaultdict(list)
    aside = set_faulty_aside(model, effects, moment).effects
    for number, effect in enumerate(effects):
        if number in aside:
            continue
        reason = next(filter(None, (_why_not(t, model, moment) for t in effect.terms)), "")
        if reason:
            missing.append(Missing(number, effect.kind, reason))
            continue
        for term in effect.terms:
            terms[term.component].append((number, term))
    origins = {code: state for state in states for code in state.group.codes}
    while True:
        rows = [
            _row(model, COMPONENTS[code], terms[code], moment, effects, origins.get(code))
            for code in sorted(terms, key=ORDER.__getitem__)
        ]
        lost = {number: reason for row in rows for number, reason in row.lost.items()}
        if not lost:
            break
        # An effect is left out whole, and what is left can then be made of other maps.
        missing += [Missing(n, effects[n].kind, reason) for n, reason in sorted(lost.items())]
        remaining = {
            code: [(n, t) for n, t in pairs if n not in lost] for code, pairs in terms.items()
        }
        terms = defaultdict(list, {code: pairs for code, pairs in remaining.items() if pairs})
    tables = [row.table for row in rows]
    taking_part = sorted({number for table in tables for number in table.effects})
    places_of_code = {table.component.code: table.positions_mm for table in tables}
    outside = [
        (number, beyond)
        for number in taking_part
        for beyond in _beyond(model, effects[number], moment, places_of_code)
    ]
    at_edges = [(number, beyond) for number, beyond in outside if beyond.is_held]
    seen = [(number, beyond) for number, beyond in outside if not beyond.is_held]
    moved = [map_read for row in rows for map_read in row.moved]
    return LiveEffects(
        tuple(replace(table, is_held=_is_held(table, at_edges)) for table in tables),
        tuple(missing),
        tuple(
            Remark(number, held_sentence(effects[number], beyond)) for number, beyond in at_edges
        ),
        (
            *(Remark(number, held_sentence(effects[number], beyond)) for number, beyond in seen),
            *(Remark(n, sentence) for n in taking_part if (sentence := unknown_range(effects[n]))),
        ),
        tuple(beyond_maps_sentences(effects, moved)),
        frozenset(map_read.effect for map_read in moved if map_read.is_refused),
    )


def _beyond(
    model: CompiledModel,
    effect: Effect,
    moment: Conditions,
    positions_mm: Mapping[str, FloatArray],
) -> list[OutsideRange]:
    """List what lies outside where an effect was learnt, at a moment and in its tables."""
    if effect.adds_nothing:
        return []
    outsides = list(conditions_beyond(model, effect, moment))
    for code in effect.components:
        at = positions_mm.get(code, np.empty(0))
        outsides += positions_beyond(effect, code, Places(at, np.zeros(at.shape)))
    return outsides


def _is_held(table: CorrectedTable, at_edges: Sequence[tuple[int, OutsideRange]]) -> bool:
    """Whether what is held is in a component's row."""
    code = table.component.code
    return any(
        number in table.effects and (not beyond.components or code in beyond.components)
        for number, beyond in at_edges
    )


class _Row(NamedTuple):
    """One component's row, the effects that cannot be in it and why, and what is outside."""

    table: CorrectedTable
    lost: Mapping[int, str]
    moved: Sequence[ReadBeyondMaps]


def _why_not(term: Term, model: CompiledModel, moment: Conditions) -> str:
    """Say why a term cannot be in a table, empty where it can."""
    component = COMPONENTS[term.component]
    missing = term.why_missing(model, moment)
    if missing or not component.is_table:
        return missing
    located = model.find(component.code)
    reach = located[1].reach_mm if located else None
    return term.shape.why_no_table(*(reach or _travel(model, component, np.empty(0))))


def _row(
    model: CompiledModel,
    component: Component,
    terms: Sequence[tuple[int, Term]],
    moment: Conditions,
    effects: Sequence[Effect],
    origin: GroupState | None,
) -> _Row:
    """Make one component's row: of the maps that enter, and of what is added beside them."""
    code = component.code
    read = [
        (number, term, reading)
        for number, term in terms
        if (reading := term.reading(model, moment, effects[number].valid)) is not None
    ]
    lost = {n: NO_NUMBER for n, _, reading in read if not np.isfinite(reading.weights).all()}
    maps = None if origin is None else origin.maps
    located = model.find(code)
    if read and located is not None and not lost:
        maps, weights = _maps_that_enter(*located, [r for _, _, r in read], origin)
        if maps is None:
            lost = dict.fromkeys((n for n, _, _ in read), NOT_COMMON)
            maps = None if origin is None else origin.maps
    if read and not lost:
        positions, forward, backward = _of_maps(component, maps, weights)
    elif origin is not None:
        member = origin.maps.member(code)
        positions, forward = member.positions_mm, origin.values[member.forward]
        backward = None if member.backward is None else origin.values[member.backward]
    else:
        positions, forward, backward = np.empty(0), np.zeros(1), None
    of_maps = {id(term) for _, term, _ in read}
    others = [(n, term, effects[n].valid) for n, term in terms if id(term) not in of_maps]
    at_mm = _positions(model, component, maps, positions, [(t, v) for _, t, v in others])
    places = at_mm if component.is_table else np.full(1, np.nan)
    up, down = (
        [
            # One moment's driver stands for all places.
            (n, np.broadcast_to(term.at(model, Places(places, sides), moment, v), places.shape))
            for n, term, v in others
        ]
        for sides in (np.ones(places.shape), -np.ones(places.shape))
    )
    lost |= {n: NO_NUMBER for n, values in (*up, *down) if not np.isfinite(values).all()}
    base = forward if backward is None else backward
    ahead = _on(at_mm, positions, forward) + sum(values for _, values in up)
    back = _on(at_mm, positions, base) + sum(values for _, values in down)
    same = backward is None and np.array_equal(ahead, back)
    table = CorrectedTable(
        component,
        at_mm,
        ahead,
        None if same else back,
        tuple(dict.fromkeys(number for number, _ in terms)),
        origin,
        maps,
        status=_gravest(reading for _, _, reading in read),
    )
    moved = [
        beyond_map._replace(values=0)
        for number, term, reading in read
        for beyond_map in read_beyond_maps(model, number, term, reading, np.ones(1, dtype=np.bool_))
    ]
    return _Row(table, lost, moved)


def _maps_that_enter(
    group: Group, member: Member, readings: Sequence[MapReading], origin: GroupState | None
) -> tuple[MapsInUse | None, FloatArray]:
    """Add up how much of each map enters; None where those have no positions in common."""
    weights = np.zeros((1, len(group.labels)))
    if origin is not None:
        rows = [origin.scale.rows[origin.bracket.lower + i] for i in (0, 1)]
        weights[0, rows] = 1.0 - origin.weight, origin.weight
    for reading in readings:
        weights = added(weights, reading.weights)
    rows = np.flatnonzero(weights).tolist()
    low, high = member.common_range(rows) if rows else (0.0, 1.0)
    if low >= high:
        return None, weights[0]
    if origin is not None and set(rows) == set(origin.maps.rows):
        rows = list(origin.maps.rows)
    # Where nothing is changed at all, it is by all maps.
    return group.maps_in_use(*(rows or range(len(group.labels)))), weights[0]


def _of_maps(
    component: Component, maps: MapsInUse | None, weights: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Add the maps up: positions, errors, and errors of the negative approach."""
    assert maps is not None
    member = maps.member(component.code)
    total = sum(
        (weights[row] * nodes for row, nodes in zip(maps.rows, maps.nodes, strict=True)),
        start=np.zeros(maps.nodes[0].shape),
    )
    backward = None if member.backward is None else total[member.backward]
    return member.positions_mm, total[member.forward], backward


def _gravest(readings: Iterable[MapReading]) -> str | None:
    """Choose the gravest status of those temperatures at which maps are really read."""
    statuses = [reading.status[0] for reading in readings if reading.is_read[0]]
    return max(statuses, key=GRAVITY.index) if statuses else None


def _travel(model: CompiledModel, component: Component, own_mm: FloatArray) -> tuple[float, float]:
    """Give the ends of a table that no map limits [mm]: of its axis' travel, or of its maps."""
    travel = travel_of(model, component)
    low, high = (travel.min_mm, travel.max_mm) if travel else (0.0, 0.0)
    if own_mm.size > 1:
        low, high = min(low, float(own_mm[0])), max(high, float(own_mm[-1]))
    return low, high


def _positions(
    model: CompiledModel,
    component: Component,
    maps: MapsInUse | None,
    own_mm: FloatArray,
    terms: Sequence[tuple[Term, Valid | None]],
) -> FloatArray:
    """Unite the maps' positions and those that the shapes need, inside what the maps cover."""
    if not component.is_table:
        return np.empty(0)
    low, high = -np.inf, np.inf
    if maps is not None:
        low, high = maps.member(component.code).common_range(maps.rows)
    if not np.isfinite(low):
        low, high = _travel(model, component, own_mm)
    nodes = [term.nodes_mm(low, high, valid) for term, valid in terms]
    needed = np.concatenate([np.empty(0), *nodes])
    needed = needed[(needed >= low) & (needed <= high)]
    positions = _distinct(np.union1d(own_mm, needed))
    return positions if positions.size else np.array([(low + high) / 2.0])


def _distinct(positions_mm: FloatArray) -> FloatArray:
    """Leave out positions that only rounding tells from their neighbour."""
    if positions_mm.size < 2:
        return positions_mm
    apart = np.diff(positions_mm) > CLOSEST_MM
    distinct: FloatArray = positions_mm[np.concatenate([[True], apart])]
    return distinct


def _on(positions_mm: FloatArray, own_mm: FloatArray, values: FloatArray) -> FloatArray:
    """Read a table at more positions between its own."""
    if own_mm.size < 2 or np.array_equal(positions_mm, own_mm):
        return np.broadcast_to(values, (max(positions_mm.size, 1),))
    return np.interp(positions_mm, own_mm, values)
