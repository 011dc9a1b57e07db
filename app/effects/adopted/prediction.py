"""What a model with its adopted effects says at many times and places."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.effects.adopted.contributions import contributions
from app.effects.adopted.faulty_sensors import set_faulty_aside
from app.effects.adopted.held import EFFECTS_ONLY, Missing, Remark, with_held
from app.effects.conditions import Conditions, StatedStates
from app.effects.effect import Effect, acting_on
from app.effects.observations import POINT_CHANNELS, ObservationRows
from app.effects.projection import Projection, places_of
from app.thermal.compiled_model import CompiledModel
from app.thermal.map_weights import OUTSIDE_MAPS
from app.thermal.prediction import (
    GRAVITY,
    BeyondTables,
    Predicted,
    predict_component,
    predict_points,
)

EFFECT_MISSING: Final = "effect-missing"
"""Status where an adopted effect lacks its condition and is not in the value."""


@dataclass(frozen=True, eq=False)
class AskedPlaces:
    """Where errors are asked for: of one component, or at points of the work volume.

    Parameters
    ----------
    component
        The component's code; None for points.
    points_mm : ndarray, shape (n, 3) [mm]
        Points; of a component only the coordinate of its axis counts.
    tool_offsets_mm : ndarray, shape (n, 3) [mm]
    directions : ndarray, shape (n, 3)
        Approach of x, y, z: +1, −1, or 0 for the mean of both.
    """

    component: str | None
    points_mm: FloatArray
    tool_offsets_mm: FloatArray
    directions: FloatArray


@dataclass(frozen=True, eq=False)
class PredictedWithEffects:
    """Predicted errors, the effects that are not in all of them, and why some are held.

    `values` have shape (n,) for a component, (n, 3) at points, NaN where `status` says why;
    `beyond` says which places the maps in use do not cover.
    """

    values: FloatArray
    status: list[str]
    missing: tuple[Missing, ...]
    beyond: tuple[BeyondTables, ...]
    held: tuple[Remark, ...] = ()


def predict_with_effects(
    model: CompiledModel, effects: Sequence[Effect], places: AskedPlaces, conditions: Conditions
) -> PredictedWithEffects:
    """Predict errors, adopted effects included.

    Parameters
    ----------
    conditions
        What held at each of the n places' times, and before.

    Raises
    ------
    InvalidContent, NotEnoughMaps
        As `predict_component` and `predict_points`.
    """
    read_by = set_faulty_aside(model, effects, conditions).conditions
    maps = predict_maps(model, effects, places, read_by)
    if not effects:
        return PredictedWithEffects(maps.values, maps.status, (), maps.beyond)
    columns = 1 if maps.values.ndim == 1 else maps.values.shape[1]
    each = np.repeat(np.arange(len(conditions)), columns)
    rows = _rows(places, conditions.times_s, columns)
    added = contributions(Projection(model, rows, conditions.take(each)), effects)
    values = maps.values + added.errors.reshape(maps.values.shape)
    lacking = set(each[added.is_lacking & np.isfinite(values.ravel())].tolist())
    by_effects = added.status.reshape(-1, columns)
    gravest = [max(row, key=GRAVITY.index) for row in by_effects]
    read = _gravest(maps.status, gravest)
    values[[by_maps == OUTSIDE_MAPS for by_maps in read]] = np.nan
    at_edges = set(each[added.is_held].tolist())
    status = [with_held(by_maps) if i in at_edges else by_maps for i, by_maps in enumerate(read)]
    status = [EFFECT_MISSING if i in lacking else by_maps for i, by_maps in enumerate(status)]
    beyond = [reading for reading in maps.beyond if reading.code not in added.beyond]
    beyond += [reading for readings in added.beyond.values() for reading in readings]
    return PredictedWithEffects(values, status, added.missing, tuple(beyond), added.held)


def _gravest(maps: Sequence[str], effects: Sequence[str]) -> list[str]:
    """Say the gravest also of the temperatures at which effects read the maps."""
    return [
        max(by_maps, by_effects, key=GRAVITY.index) if by_maps in GRAVITY else by_maps
        for by_maps, by_effects in zip(maps, effects, strict=True)
    ]


def predict_maps(
    model: CompiledModel, effects: Sequence[Effect], places: AskedPlaces, conditions: Conditions
) -> Predicted:
    """Predict what the maps say alone: nothing of a component that adopted effects alone have."""
    temperatures_c = conditions.temperatures_c
    if places.component is None:
        return predict_points(
            model, temperatures_c, places.points_mm, places.tool_offsets_mm, places.directions
        )
    code = places.component
    if code in acting_on(effects) and model.find(code) is None:
        return Predicted(np.zeros(len(conditions)), [EFFECTS_ONLY] * len(conditions))
    where = places_of(code, places.points_mm, places.directions)
    return predict_component(model, code, temperatures_c, *where)


def _rows(places: AskedPlaces, times_s: FloatArray, columns: int) -> ObservationRows:
    """Lay the places out as rows that nobody has measured: one for each direction at points."""
    n = len(times_s) * columns
    nothing = np.zeros(n, dtype=np.intp)
    return ObservationRows(
        channels=POINT_CHANNELS if places.component is None else (places.component,),
        channel=np.tile(np.arange(columns), len(times_s)),
        visit=nothing,
        replicate=nothing - 1,
        verification=nothing,
        observation=np.repeat(np.arange(len(times_s)), columns),
        times_s=np.repeat(times_s, columns),
        measured=np.full(n, np.nan),
        points_mm=np.repeat(places.points_mm, columns, axis=0),
        tool_offsets_mm=np.repeat(places.tool_offsets_mm, columns, axis=0),
        directions=np.repeat(places.directions, columns, axis=0),
        states=StatedStates([{}] * n),
        verifications=(),
    )
