"""Adopted effects in predictions at many times and places: what they add to what the maps say.

Effects that read the maps at another temperature change how much of each map enters; others add.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray, IntArray
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
from app.effects.conditions import Conditions
from app.effects.effect import Effect
from app.effects.map_tables import MapReading
from app.effects.projection import Projection, View
from app.effects.term import Term
from app.thermal.bracket import Status, StatusArray
from app.thermal.compiled_model import CompiledModel
from app.thermal.group import Group, Member
from app.thermal.map_weights import added, common_ranges, maps_at, read_maps
from app.thermal.prediction import GRAVITY, BeyondTables, beyond_tables


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
    is_held : ndarray, shape (n,)
        Where some effect is held at the edge of where it was learnt.
    held
        Why, effect by effect; which take part though they were not learnt there, or it is not
        known where they were learnt; and which read the maps outside of them.
    status : ndarray of object, shape (n,)
        The gravest of the temperatures at which effects read the maps; `at-map` where none does.
    beyond
        Of components of which effects change how much of each map enters: the places that the
        maps that enter do not cover.
    """

    errors: FloatArray
    is_lacking: BoolArray
    missing: tuple[Missing, ...]
    is_held: BoolArray
    held: tuple[Remark, ...]
    status: StatusArray
    beyond: Mapping[str, tuple[BeyondTables, ...]]


def contributions(projection: Projection, effects: Sequence[Effect]) -> Contributions:
    """Evaluate effects at many observations.

    Parameters
    ----------
    projection
        The rows: where, when, from which side; faulty sensors' readings included.

    Returns
    -------
    Contributions
        To be added to what the tables say by `SetAside.conditions`.
    """
    n = len(projection.rows)
    aside = set_faulty_aside(projection.model, effects, projection.conditions)
    parts = [
        _TermInRows(
            number, term, projection.view(term.component), *_evaluated(projection, term, effect)
        )
        for number, effect in enumerate(effects)
        for term in effect.terms
    ]
    use = _Use(effects, aside.effects, n)
    _leave_out_unknown(projection, parts, use)
    of_maps = _by_component(parts)
    plain = _plain_weights(projection.model, of_maps, aside.conditions)
    # An effect that is left out changes which maps enter, and by that what others have in common:
    # so it is looked again. Each time some effect loses some rows, so that it ends.
    while apart := _without_common_range(projection.model, of_maps, plain, use.takes_part):
        for number, rows in apart.items():
            use.leave_out(number, rows, NOT_COMMON)
    errors = np.zeros(n)
    for part in parts:
        if part.reading is None:
            rows = part.view.rows
            values = np.where(use.takes_part[part.number][rows], part.one_each, 0.0)
            errors[rows] += part.view.gains * values
    beyond = {}
    for code, parts_of in of_maps.items():
        view = parts_of[0].view
        located = _located(projection.model, code)
        weights = _with_readings(plain[code], parts_of, use.takes_part)
        change = read_maps(*located, weights, *view.places)
        change = change - read_maps(*located, plain[code], *view.places)
        errors[view.rows] += view.gains * np.where(np.isfinite(change), change, 0.0)
        beyond[code] = beyond_tables(located[1], weights, view.places.positions_mm)
    is_held, remarks = _held_remarks(projection, effects, use.takes_part)
    status, moved = _statuses(projection.model, parts, use.takes_part, n)
    remarks += beyond_maps_sentences(effects, moved)
    missing = tuple(use.missing)
    return Contributions(errors, use.is_lacking, missing, is_held, tuple(remarks), status, beyond)


class _TermInRows(NamedTuple):
    """One term in the rows in which it shows: as weights of maps, or as numbers.

    `one_each` has a number for each of the rows that is not finite where a condition is missing.
    """

    number: int
    term: Term
    view: View
    reading: MapReading | None
    one_each: FloatArray


class _Use:
    """In which of n rows each effect takes part, and which were left out and why."""

    def __init__(self, effects: Sequence[Effect], aside: Mapping[int, BoolArray], n: int) -> None:
        self._effects = effects
        nowhere = np.zeros(n, dtype=np.bool_)
        self.takes_part = [~aside.get(number, nowhere) for number in range(len(effects))]
        self.is_lacking = np.zeros(n, dtype=np.bool_)
        self.missing: list[Missing] = []

    def leave_out(self, number: int, rows: IntArray, reason: str) -> None:
        """Leave an effect out of some rows."""
        sentence = f"{reason} ({rows.size} values)"
        self.missing.append(Missing(number, self._effects[number].kind, sentence))
        self.is_lacking[rows] = True
        self.takes_part[number][rows] = False


def _leave_out_unknown(projection: Projection, parts: Sequence[_TermInRows], use: _Use) -> None:
    """Leave each effect out, with all of its terms, where one of its conditions is not known."""
    for number, takes_part in enumerate(use.takes_part):
        parts_of_effect = [part for part in parts if part.number == number]
        is_unknown = np.zeros(len(takes_part), dtype=np.bool_)
        for part in parts_of_effect:
            is_unknown[part.view.rows[~np.isfinite(part.one_each)]] = True
        unknown = np.flatnonzero(is_unknown & takes_part)
        if unknown.size:
            there = projection.conditions.take(unknown)
            reasons = (part.term.why_missing(projection.model, there) for part in parts_of_effect)
            use.leave_out(number, unknown, next(filter(None, reasons), NO_NUMBER))


def _plain_weights(
    model: CompiledModel, of_maps: Mapping[str, Sequence[_TermInRows]], conditions: Conditions
) -> dict[str, FloatArray]:
    """Give how much of each map enters components without effects, shape (m, M) each."""
    weights = {}
    for code, parts in of_maps.items():
        rows = parts[0].view.rows
        temperatures_c = conditions.take(rows).temperatures_c
        weights[code] = maps_at(model, _located(model, code)[0], temperatures_c, rows.size).weights
    return weights


def _evaluated(
    projection: Projection, term: Term, effect: Effect
) -> tuple[MapReading | None, FloatArray]:
    view = projection.view(term.component)
    reading = term.reading(projection.model, view.conditions, effect.valid)
    if reading is not None:
        return reading, reading.weights.sum(axis=1)
    return None, term.at(projection.model, view.places, view.conditions, effect.valid)


def _by_component(parts: Iterable[_TermInRows]) -> dict[str, list[_TermInRows]]:
    """Put the parts that change how much of each map enters together."""
    by_code: dict[str, list[_TermInRows]] = defaultdict(list)
    for part in parts:
        if part.reading is not None:
            by_code[part.term.component].append(part)
    return by_code


def _located(model: CompiledModel, code: str) -> tuple[Group, Member]:
    located = model.find(code)
    assert located is not None
    return located


def _with_readings(
    plain: FloatArray, parts: Iterable[_TermInRows], takes_part: Sequence[BoolArray]
) -> FloatArray:
    """Add up how much of each map enters one component with its effects, shape (m, M)."""
    weights = plain
    for part in parts:
        assert part.reading is not None
        use = takes_part[part.number][part.view.rows]
        weights = added(weights, np.where(use[:, None], part.reading.weights, 0.0))
    return weights


def _without_common_range(
    model: CompiledModel,
    of_maps: Mapping[str, Sequence[_TermInRows]],
    plain: Mapping[str, FloatArray],
    takes_part: Sequence[BoolArray],
) -> dict[int, IntArray]:
    """List the effects by which maps enter that have no positions in common, and where."""
    lost: dict[int, list[IntArray]] = defaultdict(list)
    for code, parts in of_maps.items():
        low, high = common_ranges(
            _located(model, code)[1], _with_readings(plain[code], parts, takes_part)
        )
        rows = parts[0].view.rows[(low >= high) & ~np.isnan(plain[code]).any(axis=1)]
        for part in parts:
            used_rows = rows[takes_part[part.number][rows]]
            if used_rows.size:
                lost[part.number].append(used_rows)
    return {number: np.unique(np.concatenate(rows)) for number, rows in lost.items()}


def _held_remarks(
    projection: Projection, effects: Sequence[Effect], takes_part: Sequence[BoolArray]
) -> tuple[BoolArray, list[Remark]]:
    """Say where effects are held, and which take part where they were not learnt."""
    is_held = np.zeros(len(projection.rows), dtype=np.bool_)
    remarks: list[Remark] = []
    for number, effect in enumerate(effects):
        in_effect = takes_part[number] & _shows(projection, effect)
        if in_effect.any() and (sentence := unknown_range(effect)):
            remarks.append(Remark(number, sentence))
        for beyond, rows in _rows_beyond(projection, effect, takes_part[number]):
            if beyond.is_held:
                is_held[rows] = True
            remarks.append(Remark(number, f"{held_sentence(effect, beyond)} ({rows.size} values)"))
    return is_held, remarks


def _statuses(
    model: CompiledModel, parts: Iterable[_TermInRows], takes_part: Sequence[BoolArray], n: int
) -> tuple[StatusArray, list[ReadBeyondMaps]]:
    """Say the gravest of the temperatures at which effects read the maps, and which are outside."""
    status = np.full(n, Status.AT_MAP, dtype=object)
    moved: list[ReadBeyondMaps] = []
    for part in parts:
        reading, rows = part.reading, part.view.rows
        if reading is None:
            continue
        use = takes_part[part.number][rows] & reading.is_read
        for candidate in GRAVITY[1:]:
            concerned = rows[use & (reading.status == candidate)]
            graver = [GRAVITY.index(s) < GRAVITY.index(candidate) for s in status[concerned]]
            status[concerned[np.array(graver, dtype=np.bool_)]] = candidate
        moved += read_beyond_maps(model, part.number, part.term, reading, use)
    return status, moved


def _shows(projection: Projection, effect: Effect) -> BoolArray:
    """Say in which rows the components of an effect show."""
    shows = np.zeros(len(projection.rows), dtype=np.bool_)
    for code in effect.components:
        shows[projection.view(code).rows] = True
    return shows


def _rows_beyond(
    projection: Projection, effect: Effect, takes_part: BoolArray
) -> list[tuple[OutsideRange, IntArray]]:
    """List what lies outside where an effect was learnt, with the rows in which it does."""
    if effect.valid is None or effect.adds_nothing:
        return []
    outsides = []
    for code in effect.components:
        view = projection.view(code)
        outsides += [
            (beyond, view.rows[beyond.is_beyond & takes_part[view.rows]])
            for beyond in positions_beyond(effect, code, view.places)
        ]
    in_effect = takes_part & _shows(projection, effect)
    rows = np.flatnonzero(in_effect)
    there = projection.conditions.take(rows)
    for beyond in conditions_beyond(projection.model, effect, there):
        view_rows = [projection.view(code).rows for code in beyond.components or effect.components]
        outside = rows[beyond.is_beyond]
        outsides.append((beyond, outside[np.isin(outside, np.concatenate(view_rows))]))
    return [pair for pair in outsides if pair[1].size]
