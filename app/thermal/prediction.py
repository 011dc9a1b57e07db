"""What a model says at many times and places: the table, asked point by point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from app.arrays import FloatArray
from app.errors import InvalidContent, NotEnoughMaps, list_names
from app.geometry.components import LINEAR_LETTERS, ORDER
from app.geometry.volumetric_error import volumetric_error
from app.thermal.bracket import Status
from app.thermal.compiled_model import CompiledModel
from app.thermal.group import Group, Member
from app.thermal.map_weights import (
    NO_READING,
    OUTSIDE_MAPS,
    MapWeights,
    common_ranges,
    maps_at,
    read_maps,
)

GRAVITY = [
    Status.AT_MAP,
    Status.INTERPOLATED,
    Status.STAND_IN,
    Status.EXTRAPOLATED,
    Status.CLAMPED,
    OUTSIDE_MAPS,
    NO_READING,
]
"""Statuses from the most to the least trustworthy."""


@dataclass(frozen=True, slots=True)
class BeyondTables:
    """Places that the maps in use do not cover, so that the end values of their range hold.

    `ranges_mm` are the different ranges, as tables at these places' temperatures have them.
    """

    code: str
    count: int
    ranges_mm: tuple[tuple[float, float], ...]


@dataclass(frozen=True, slots=True)
class Predicted:
    """Predicted errors, NaN where `status` says why there is none."""

    values: FloatArray
    status: list[str]
    beyond: tuple[BeyondTables, ...] = ()


def predict_component(
    model: CompiledModel,
    code: str,
    temperatures_c: Mapping[str, FloatArray],
    positions_mm: FloatArray,
    directions: FloatArray,
) -> Predicted:
    """Predict one component at n times.

    Parameters
    ----------
    temperatures_c : mapping of sensor to ndarray, shape (n,) [°C]
        NaN where a sensor has no usable temperature, left out where it has none at
        all; its stand-in then serves.
    positions_mm : ndarray, shape (n,) [mm]
        Positions on the component's axis; ignored where it has none. Outside what the
        maps in use cover, the end values of that range hold.
    directions : ndarray, shape (n,)
        +1 or −1 for the direction of approach, 0 where unknown (the mean of both).

    Returns
    -------
    Predicted
        Values of shape (n,) [the component's unit].

    Raises
    ------
    InvalidContent
        If the model does not have the component.
    """
    located = model.find(code)
    if located is None:
        have = sorted((c for group in model.groups for c in group.codes), key=ORDER.__getitem__)
        raise InvalidContent(
            f"expected a component of the model ({list_names(have)}), "
            f"got {code}: {model.omitted.get(code, 'no map has it')}"
        )
    group, member = located
    weights, status = _maps_at(model, group, temperatures_c, len(positions_mm))
    return Predicted(
        read_maps(group, member, weights, positions_mm, directions),
        status.tolist(),
        beyond_tables(member, weights, positions_mm),
    )


def predict_points(
    model: CompiledModel,
    temperatures_c: Mapping[str, FloatArray],
    points_mm: FloatArray,
    tool_offsets_mm: FloatArray,
    directions: FloatArray,
) -> Predicted:
    """Predict the volumetric error at n points and times.

    Parameters
    ----------
    points_mm, tool_offsets_mm : ndarray, shape (n, 3) [mm]
        Nominal positions and tool offsets.
    directions : ndarray, shape (n, 3)
        For each axis as for `predict_component`.

    Returns
    -------
    Predicted
        Values of shape (n, 3) [µm]; the status is the least trustworthy of all
        components', and where that is none, all three values are NaN.

    Raises
    ------
    NotEnoughMaps
        If no component has two maps: no error known is not an error of zero.
    """
    if not model.groups:
        raise NotEnoughMaps(model.why_nothing())
    errors: dict[str, FloatArray] = {}
    statuses: list[Sequence[str]] = []
    beyond: list[BeyondTables] = []
    for group in model.groups:
        weights, status = _maps_at(model, group, temperatures_c, len(points_mm))
        statuses.append(status.tolist())
        for member in group.members:
            axis = member.component.axis
            row = LINEAR_LETTERS.index(axis) if axis else 0
            errors[member.component.code] = read_maps(
                group, member, weights, points_mm[:, row], directions[:, row]
            )
            beyond += beyond_tables(member, weights, points_mm[:, row])
    values, _ = volumetric_error(
        model.machine.chain, errors, points_mm, tool_offsets_mm, model.measuring_lines
    )
    worst = [max(row, key=GRAVITY.index) for row in zip(*statuses, strict=True)]
    # Also where the unknown component happens to have no lever at this point.
    values[[status in (OUTSIDE_MAPS, NO_READING) for status in worst]] = np.nan
    return Predicted(values, worst, tuple(beyond))


def beyond_tables(
    member: Member, weights: FloatArray, positions_mm: FloatArray
) -> tuple[BeyondTables, ...]:
    """List the positions that the maps that enter do not cover.

    Parameters
    ----------
    weights : ndarray, shape (n, M)
        How much of each map enters; NaN where that is not known.
    positions_mm : ndarray, shape (n,) [mm]
    """
    low, high = common_ranges(member, weights)
    there = ((positions_mm < low) | (positions_mm > high)) & ~np.isnan(weights).any(axis=1)
    if not there.any():
        return ()
    ranges = np.unique(np.column_stack([low[there], high[there]]), axis=0)
    return (
        BeyondTables(
            member.component.code,
            int(np.count_nonzero(there)),
            tuple((float(a), float(b)) for a, b in ranges),
        ),
    )


def _maps_at(
    model: CompiledModel, group: Group, temperatures_c: Mapping[str, FloatArray], n: int
) -> MapWeights:
    """Read the maps where the policy allows it."""
    map_weights = maps_at(model, group, temperatures_c, n)
    map_weights.weights[map_weights.status == OUTSIDE_MAPS] = np.nan
    return map_weights
