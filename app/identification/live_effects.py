"""Adopted effects in what the service gives out: live tables, and predictions at many times."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray
from app.geometry.axis_table import CLOSEST_MM
from app.geometry.components import COMPONENTS, ORDER, Component
from app.identification.conditions import Conditions
from app.identification.effects.effect import Effect
from app.identification.effects.shape import Places
from app.identification.effects.site import travel_of
from app.identification.effects.term import Term
from app.identification.effects.valid import Valid
from app.identification.faulty_sensors import set_faulty_aside
from app.identification.held_effects import (
    Beyond,
    Remark,
    conditions_beyond,
    held_sentence,
    positions_beyond,
    unknown_range,
)
from app.identification.map_tables import positions_of
from app.identification.projection import Projection, sum_of_terms
from app.thermal.compiled_model import CompiledModel, GroupState

NO_NUMBER: Final = "what drives it gives no number here"


@dataclass(frozen=True, slots=True)
class Missing:
    """An effect that is not in an answer, and why."""

    effect: int
    kind: str
    reason: str


@dataclass(frozen=True, eq=False)
class Correction:
    """What effects add to one component at one moment.

    Parameters
    ----------
    component
        The component; the model need not have it.
    positions_mm : ndarray, shape (k,) [mm]
        Increasing; none for a component without argument.
    forward, backward : ndarray, shape (k,), or (1,) without argument
        What is to be added to the errors of either approach [the component's unit].
    effects
        Numbers of the effects that take part.
    is_held
        Whether any of them is held at the edge of where it was learnt.
    """

    component: Component
    positions_mm: FloatArray
    forward: FloatArray
    backward: FloatArray
    effects: tuple[int, ...]
    is_held: bool = False


@dataclass(frozen=True, eq=False)
class LiveEffects:
    """All corrections at one moment, the effects that lack something, and why some are held.

    `unknown` are those that take part although it is not known where they were learnt.
    """

    corrections: tuple[Correction, ...]
    missing: tuple[Missing, ...]
    held: tuple[Remark, ...] = ()
    unknown: tuple[Remark, ...] = ()


@dataclass(frozen=True, eq=False)
class Contributions:
    """What effects add to many predictions.

    Parameters
    ----------
    errors : ndarray, shape (n,)
        What is to be added [the rows' units]; an effect adds nothing where its condition is
        not known.
    is_lacking : ndarray, shape (n,)
        Where some effect's condition is not known.
    missing
        The effects that lack a condition at some row.
    is_held : ndarray, shape (n,)
        Where some effect is held at the edge of where it was learnt.
    held
        Why, effect by effect; and which take part though it is not known where they were learnt.
    """

    errors: FloatArray
    is_lacking: BoolArray
    missing: tuple[Missing, ...]
    is_held: BoolArray
    held: tuple[Remark, ...]


@dataclass(frozen=True, eq=False)
class CorrectedTable:
    """One component's errors with its effects.

    Parameters
    ----------
    component
        The component.
    positions_mm : ndarray, shape (k,) [mm]
        The maps' positions and those that the effects need.
    errors : ndarray, shape (k,), or (1,) without argument [the component's unit]
        Actual minus nominal.
    backward_errors : ndarray, same shape, or None
        The same for positions approached in the negative direction, where that differs.
    effects
        Numbers of the effects in it.
    origin
        The group's state without effects; None for a component that no map has.
    is_held
        Whether any of the effects is held at the edge of where it was learnt.
    """

    component: Component
    positions_mm: FloatArray
    errors: FloatArray
    backward_errors: FloatArray | None
    effects: tuple[int, ...]
    origin: GroupState | None
    is_held: bool = False


def corrections(model: CompiledModel, effects: Sequence[Effect], moment: Conditions) -> LiveEffects:
    """Evaluate effects at one moment, at all positions that their tables need.

    Parameters
    ----------
    model
        The compiled model.
    effects
        The adopted effects, numbered by their order.
    moment
        Conditions of one moment (`Conditions.of_moment`), faulty sensors' readings included.

    Returns
    -------
    LiveEffects
        To be added to what the tables say by `SetAside.conditions`. An effect that lacks its
        condition is left out entirely, with the reason.
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
    evaluated = [
        _evaluated(model, COMPONENTS[code], terms[code], moment, effects)
        for code in sorted(terms, key=ORDER.__getitem__)
    ]
    lost = {part.effect for one in evaluated for part in one.parts if not part.is_finite}
    missing += [Missing(number, effects[number].kind, NO_NUMBER) for number in sorted(lost)]
    found = [c for one in evaluated if (c := _correction(one, lost)).effects]
    taking_part = sorted({number for c in found for number in c.effects})
    held, places_of_code = [], {c.component.code: c.positions_mm for c in found}
    for number in taking_part:
        beyond = _beyond(model, effects[number], moment, places_of_code)
        held += [(number, one) for one in beyond]
    return LiveEffects(
        tuple(replace(c, is_held=_is_held(c, held)) for c in found),
        tuple(missing),
        tuple(Remark(number, held_sentence(effects[number], one)) for number, one in held),
        tuple(Remark(n, said) for n in taking_part if (said := unknown_range(effects[n]))),
    )


def _beyond(
    model: CompiledModel,
    effect: Effect,
    moment: Conditions,
    positions_mm: Mapping[str, FloatArray],
) -> list[Beyond]:
    """List what lies outside where an effect was learnt, at a moment and in its tables."""
    if effect.adds_nothing:
        return []
    found = list(conditions_beyond(model, effect, moment))
    for code in effect.components:
        at = positions_mm.get(code, np.empty(0))
        found += positions_beyond(effect, code, Places(at, np.zeros(at.shape)))
    return found


def _is_held(correction: Correction, held: Sequence[tuple[int, Beyond]]) -> bool:
    """Whether what is held is in a component's correction."""
    return any(
        number in correction.effects and beyond.component in ("", correction.component.code)
        for number, beyond in held
    )


def corrected_tables(
    states: Iterable[GroupState], found: Sequence[Correction]
) -> list[CorrectedTable]:
    """Add corrections to the tables of one moment.

    Parameters
    ----------
    states
        What `CompiledModel.errors_at` found.
    found
        The corrections of the same moment.

    Returns
    -------
    list of CorrectedTable
        Every component of the states and of the corrections, in the order of tables.
    """
    by_code = {correction.component.code: correction for correction in found}
    tables = []
    for state in states:
        for member in state.members:
            own = CorrectedTable(
                member.component,
                member.positions_mm,
                state.values[member.forward],
                None if member.backward is None else state.values[member.backward],
                (),
                state,
            )
            correction = by_code.pop(member.component.code, None)
            tables.append(own if correction is None else _added(own, correction))
    for correction in by_code.values():
        nothing = np.zeros(correction.forward.shape)
        new = CorrectedTable(correction.component, correction.positions_mm, nothing, None, (), None)
        tables.append(_added(new, correction))
    return sorted(tables, key=lambda table: ORDER[table.component.code])


def contributions(projection: Projection, effects: Sequence[Effect]) -> Contributions:
    """Evaluate effects at many observations.

    Parameters
    ----------
    projection
        The rows: where, when, from which side; faulty sensors' readings included.
    effects
        The adopted effects.

    Returns
    -------
    Contributions
        To be added to what the tables say by `SetAside.conditions`.
    """
    total = np.zeros(len(projection.rows))
    lacking = np.zeros(len(projection.rows), dtype=np.bool_)
    is_held = np.zeros(len(projection.rows), dtype=np.bool_)
    missing, held = [], []
    aside = set_faulty_aside(projection.model, effects, projection.conditions).effects
    for number, effect in enumerate(effects):
        own = sum_of_terms(projection, effect.terms, effect.valid)
        own = np.where(aside.get(number, False), 0.0, own)
        unknown = np.flatnonzero(~np.isfinite(own))
        if unknown.size:
            there = projection.conditions.take(unknown)
            reasons = (t.why_missing(projection.model, there) for t in effect.terms)
            reason = next(filter(None, reasons), NO_NUMBER)
            missing.append(Missing(number, effect.kind, f"{reason} ({unknown.size} values)"))
            lacking[unknown] = True
        total += np.where(np.isfinite(own), own, 0.0)
        takes_part = np.isfinite(own) & ~np.asarray(aside.get(number, False))
        takes_part &= _shows(projection, effect)
        if takes_part.any() and (said := unknown_range(effect)):
            held.append(Remark(number, said))
        for beyond, rows in _rows_beyond(projection, effect, takes_part):
            is_held[rows] = True
            held.append(Remark(number, f"{held_sentence(effect, beyond)} ({rows.size} values)"))
    return Contributions(total, lacking, tuple(missing), is_held, tuple(held))


def _shows(projection: Projection, effect: Effect) -> BoolArray:
    """Say in which rows the components of an effect show."""
    found = np.zeros(len(projection.rows), dtype=np.bool_)
    for code in effect.components:
        found[projection.view(code).rows] = True
    return found


def _rows_beyond(
    projection: Projection, effect: Effect, takes_part: BoolArray
) -> list[tuple[Beyond, IntArray]]:
    """List what lies outside where an effect was learnt, with the rows in which it does."""
    if effect.valid is None or effect.adds_nothing:
        return []
    found = []
    for code in effect.components:
        view = projection.view(code)
        found += [
            (beyond, view.rows[beyond.is_beyond & takes_part[view.rows]])
            for beyond in positions_beyond(effect, code, view.places)
        ]
    rows = np.flatnonzero(takes_part)
    there = projection.conditions.take(rows)
    found += [
        (beyond, rows[beyond.is_beyond])
        for beyond in conditions_beyond(projection.model, effect, there)
    ]
    return [one for one in found if one[1].size]


class _Part(NamedTuple):
    """What one term adds to either approach."""

    effect: int
    forward: FloatArray
    backward: FloatArray

    @property
    def is_finite(self) -> bool:
        return bool(np.isfinite(self.forward).all() and np.isfinite(self.backward).all())


class _Evaluated(NamedTuple):
    """All terms of one component at common positions."""

    component: Component
    positions_mm: FloatArray
    parts: list[_Part]


def _why_not(term: Term, model: CompiledModel, moment: Conditions) -> str:
    """Say why a term cannot be in a table, empty where it can."""
    component = COMPONENTS[term.component]
    missing = term.why_missing(model, moment)
    if missing or not component.is_table:
        return missing
    return term.shape.why_no_table(*_ends(model, component))


def _evaluated(
    model: CompiledModel,
    component: Component,
    terms: Sequence[tuple[int, Term]],
    moment: Conditions,
    effects: Sequence[Effect],
) -> _Evaluated:
    learnt = [(n, term, effects[n].valid) for n, term in terms]
    positions = _positions(model, component, [(term, valid) for _, term, valid in learnt])
    at = positions if component.is_table else np.full(1, np.nan)
    up, down = (Places(at, np.full(at.shape, side)) for side in (1.0, -1.0))
    parts = [
        _Part(n, *(term.everywhere_at(model, side, moment, valid) for side in (up, down)))
        for n, term, valid in learnt
    ]
    return _Evaluated(component, positions, parts)


def _correction(evaluated: _Evaluated, lost: Collection[int]) -> Correction:
    """Add the terms up, without those of lost effects."""
    component, positions, parts = evaluated
    kept = [part for part in parts if part.effect not in lost]
    nothing = np.zeros(max(positions.size, 1))
    forward = sum((part.forward for part in kept), start=nothing)
    backward = sum((part.backward for part in kept), start=nothing)
    numbers = tuple(dict.fromkeys(part.effect for part in kept))
    return Correction(component, positions, forward, backward, numbers)


def _ends(model: CompiledModel, component: Component) -> tuple[float, float]:
    """Give the ends of a component's table [mm]: of its axis' travel, or of its maps."""
    found = model.find(component.code)
    own = positions_of(found[1] if found else None)
    travel = travel_of(model, component)
    low, high = (travel.min_mm, travel.max_mm) if travel else (0.0, 0.0)
    if own.size > 1:
        low, high = min(low, float(own[0])), max(high, float(own[-1]))
    return low, high


def _positions(
    model: CompiledModel, component: Component, terms: Sequence[tuple[Term, Valid | None]]
) -> FloatArray:
    """Unite the table's positions and those that the shapes need."""
    if not component.is_table:
        return np.empty(0)
    found = model.find(component.code)
    own = positions_of(found[1] if found else None)
    low, high = _ends(model, component)
    needed = [own, *(term.nodes_mm(low, high, valid) for term, valid in terms)]
    positions = _distinct(np.unique(np.concatenate(needed)))
    return positions if positions.size else np.array([(low + high) / 2.0])


def _distinct(positions_mm: FloatArray) -> FloatArray:
    """Leave out positions that only rounding tells from their neighbour."""
    if positions_mm.size < 2:
        return positions_mm
    apart = np.diff(positions_mm) > CLOSEST_MM
    found: FloatArray = positions_mm[np.concatenate([[True], apart])]
    return found


def _added(own: CorrectedTable, correction: Correction) -> CorrectedTable:
    positions = correction.positions_mm
    forward = _on(positions, own.positions_mm, own.errors) + correction.forward
    base = own.errors if own.backward_errors is None else own.backward_errors
    backward = _on(positions, own.positions_mm, base) + correction.backward
    same = own.backward_errors is None and np.array_equal(correction.forward, correction.backward)
    return CorrectedTable(
        own.component,
        positions,
        forward,
        None if same else backward,
        correction.effects,
        own.origin,
        correction.is_held,
    )


def _on(positions_mm: FloatArray, own_mm: FloatArray, values: FloatArray) -> FloatArray:
    """Read a table at more positions; outside it its end values hold."""
    if own_mm.size < 2 or np.array_equal(positions_mm, own_mm):
        return np.broadcast_to(values, (max(positions_mm.size, 1),))
    return np.interp(positions_mm, own_mm, values)
