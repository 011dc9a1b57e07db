"""What mistakes in the data leave in the rows: the maps of the right data, less those of the noted.

A mistake in the data or the wiring is no error of the machine. It is tested by asking the same
maps at the temperatures, positions or tools that would have been noted without it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import TypeAlias

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.effects.observations import ObservationRows
from app.effects.projection import Projection
from app.effects.shape import Sensitivity

Supposed: TypeAlias = Callable[[Projection, float | None], FloatArray]
"""Gives for a value of the nonlinear parameter what measured minus predicted would be, (n,)."""

InMaps: TypeAlias = Callable[[str, str], tuple[tuple[str, float], ...]]
"""Gives for a component and its sensor label and temperature difference of maps [K]."""


def since(supposed: Supposed) -> Supposed:
    """Let what a mistake leaves begin at a time: the nonlinear parameter [s]."""
    # All times share the whole, which asks the maps of every row.
    whole = lru_cache(maxsize=1)(lambda projection: supposed(projection, None))

    def begun(projection: Projection, theta: float | None) -> FloatArray:
        has_begun = projection.rows.times_s >= float(theta or 0.0)
        return np.where(has_begun, whole(projection), 0.0)

    return begun


def left_by_temperatures(
    projection: Projection, by_k: Mapping[str, FloatArray], in_maps_k: InMaps | None = None
) -> FloatArray:
    """Say what is left where sensors were not as warm as they said.

    Parameters
    ----------
    by_k : mapping of sensor to ndarray, shape (n,) [K]
        What is to be added to its reading in each row; NaN where that is not known.
    in_maps_k
        Gives for a component and its sensor what is to be added to the temperature of each map too;
        None: the maps' are right.

    Returns
    -------
    ndarray, shape (n,) [the rows' units]
        The maps at the moved temperatures minus the maps at those that were read.
    """
    model, supposed = projection.model, np.zeros(len(projection.rows))
    for group in model.groups:
        if group.sensor not in by_k:
            continue
        for code in group.codes:
            view = projection.view(code)
            by_maps = () if in_maps_k is None else in_maps_k(code, group.sensor)
            shape = Sensitivity(False, by_maps).readable(model, code)
            reading = shape.reading(model, code, view.conditions, by_k[group.sensor][view.rows])
            if reading is not None:
                supposed[view.rows] += view.gains * projection.of_maps(code, reading.weights)
    return supposed


def left_by_places(
    projection: Projection, rows: ObservationRows, which: BoolArray, sign: float = 1.0
) -> FloatArray:
    """Say what is left where positions or tools were not those that were noted.

    Parameters
    ----------
    rows
        The same rows with the places or tools that they really had.
    which : ndarray, shape (n,)
        The rows that were noted otherwise; nothing is left in the others.
    sign
        −1 where the measured value has the wrong sign too.

    Returns
    -------
    ndarray, shape (n,) [the rows' units]
    """
    conditions = projection.conditions.take(np.flatnonzero(which))
    really = Projection(projection.model, rows.take(which), conditions)
    supposed = np.zeros(len(projection.rows))
    supposed[which] = sign * really.predicted - projection.predicted[which]
    return supposed
