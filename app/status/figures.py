"""Figures of a verdict: largest values, what lies outside the maps, how fast a table changes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TypeAlias

import numpy as np

from app.arrays import FloatArray
from app.compensation.table import CompensationTable
from app.errors import ThermapError
from app.geometry.components import Component, Kind
from app.status.machine_status import BeyondMaps, Largest
from app.thermal.bracket import Status
from app.thermal.group import Group, Member
from app.thermal.group_state import GroupState

_Values: TypeAlias = tuple[Component, FloatArray, FloatArray, FloatArray | None]
"""Component, positions [mm], values there [its unit]: approached forward, and backward or None."""


def largest_of(values: Iterable[_Values]) -> Largest | None:
    """Find the largest value of components: of a displacement where there is one."""
    candidates = [
        (
            component.kind in (Kind.LINEAR, Kind.STRAIGHTNESS),
            abs(side[at]),
            component,
            side[at],
            p,
            b,
        )
        for component, positions, *sides in values
        for b, side in enumerate(sides)
        if side is not None and side.size
        for at in (int(np.abs(side).argmax()),)
        for p in (float(positions[at]) if component.is_table else None,)
    ]
    if not candidates:
        return None
    _, _, component, value, position_mm, backward = max(
        candidates, key=lambda candidate: candidate[:2]
    )
    return Largest.of(component, float(value), position_mm, is_backward=bool(backward))


def list_beyond(table: CompensationTable) -> list[BeyondMaps]:
    """List the components outside their maps, and what going on in a line would add."""
    bases = {c.component.code: c.basis for c in table.components}
    beyond = []
    for state in table.states:
        if state.status not in (Status.CLAMPED, Status.EXTRAPOLATED):
            continue
        members = [
            m
            for m in state.members
            if bases[m.component.code].status == state.status
            and bases[m.component.code].sensor == state.sensor
        ]
        if not members:
            continue
        is_held = state.status is Status.CLAMPED
        beyond.append(
            BeyondMaps(
                sensor=state.sensor,
                outside_k=outside_k(state.temperature_c, state.scale.temperatures_c),
                components=tuple(m.component.code for m in members),
                held_at=(state.upper_map if state.weight > 0.5 else state.lower_map)
                if is_held
                else None,
                lacks=_lacking(state, members) if is_held else None,
            )
        )
    return sorted(beyond, key=lambda item: -abs(item.outside_k))


def _lacking(state: GroupState, members: Sequence[Member]) -> Largest | None:
    """What the straight line through the two nearest maps would add to the compensation."""
    lower = state.bracket.lower
    t_n, t_m = state.scale.temperatures_c[lower], state.scale.temperatures_c[lower + 1]
    going_on = (state.temperature_c - t_n) / (t_m - t_n)
    # Of the compensation, which is −e: what is held less what goes on, and not the other way round.
    return largest_of(_of_difference(state, members, state.weight - going_on))


def change_per_h(
    table: CompensationTable | ThermapError, rates: Mapping[str, float | None]
) -> Largest | None:
    """How the compensation of components without effects changes at the sensors' rates [K/h]."""
    if isinstance(table, ThermapError):
        return None
    with_effects = {code for effect in table.effects for code in effect.components}
    values: list[_Values] = []
    for state in table.states:
        rate = rates[state.sensor]
        members = [m for m in state.members if m.component.code not in with_effects]
        if rate is None or not members:
            continue
        per_h = 0.0 if state.status is Status.CLAMPED else rate / state.span_c
        values += _of_difference(state, members, -per_h)
    return largest_of(values)


def _of_difference(state: GroupState, members: Sequence[Member], share: float) -> Iterator[_Values]:
    """Give of each component a share of the errors by which its two nearest maps differ."""
    scale, lower = state.scale, state.bracket.lower
    maps = state.group.maps_in_use(scale.rows[lower], scale.rows[lower + 1])
    values = share * (maps.nodes[1] - maps.nodes[0])
    codes = {m.component.code for m in members}
    for m in maps.members:
        if m.component.code in codes:
            backward = None if m.backward is None else values[m.backward]
            yield m.component, m.positions_mm, values[m.forward], backward


def between_maps_c(groups: Sequence[Group]) -> tuple[float, float] | None:
    """Between which temperatures all groups of one sensor lie between maps [°C]."""
    if not groups:
        return None
    ends = [group.scales[0].temperatures_c for group in groups]
    return max(t[0] for t in ends), min(t[-1] for t in ends)


def excess_k(values_c: FloatArray, ends_c: Sequence[float]) -> FloatArray:
    """Give by how much temperatures are outside the maps.

    Parameters
    ----------
    values_c : ndarray, shape (n,) [°C]
    ends_c
        Temperatures of the maps, rising [°C].

    Returns
    -------
    ndarray, shape (n,) [K]
        Positive above the last map, negative below the first, else 0.
    """
    above, below = np.maximum(values_c - ends_c[-1], 0.0), np.minimum(values_c - ends_c[0], 0.0)
    excess: FloatArray = above + below
    return excess


def outside_k(temperature_c: float, ends_c: Sequence[float]) -> float:
    """Give the same of one temperature, to 0.1 mK."""
    return round(float(excess_k(np.array([temperature_c]), ends_c)[0]), 4)
