"""Maps read at many temperatures: how much of each map enters, and what that gives at positions.

Whatever is made of the maps of one component, at one temperature or as a difference of two, is a
sum of its maps with weights. The weights say which maps enter, those say at which positions it is
known, and there it is read.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from app.arrays import FloatArray, IntArray
from app.thermal.bracket import Brackets, StatusArray
from app.thermal.compiled_model import CompiledModel
from app.thermal.group import Group, Member, Scale
from app.thermal.resampling import hat_weights

NO_READING = "no-reading"
OUTSIDE_MAPS = "outside-maps"

ROUNDING = 1e-12
"""What is left of a weight where maps cancel each other but for rounding."""


class MapWeights(NamedTuple):
    """How much of each map enters at n moments, and how that came about.

    Parameters
    ----------
    weights : ndarray, shape (n, M)
        By rows of the group's matrix; NaN where the temperature is not known.
    status : ndarray of object, shape (n,)
        `no-reading` where the temperature is not known, `outside-maps` where the machine's policy
        does not allow it: the weights are then those of the edge.
    """

    weights: FloatArray
    status: StatusArray


def maps_at(
    model: CompiledModel, group: Group, temperatures_c: Mapping[str, FloatArray], n: int
) -> MapWeights:
    """Say how much of each map enters a group's errors, as the table has them.

    Parameters
    ----------
    temperatures_c : mapping of sensor to ndarray, shape (n,) [°C]
        NaN where a sensor has no usable temperature, left out where it has none at
        all; its stand-in then serves.
    """
    weights = np.full((n, len(group.labels)), np.nan)
    status = np.full(n, NO_READING, dtype=object)
    open_ = np.ones(n, dtype=np.bool_)
    for scale in group.scales:
        t = temperatures_c.get(scale.sensor)
        open_rows = (
            np.flatnonzero(open_ & ~np.isnan(t)) if t is not None else np.empty(0, dtype=np.intp)
        )
        if t is None or not open_rows.size:
            continue
        brackets = model.brackets(group, scale, t[open_rows])
        weights[open_rows] = weights_of(scale, brackets)
        status[open_rows] = brackets.status
        status[open_rows[brackets.is_refused]] = OUTSIDE_MAPS
        open_[open_rows] = False
    return MapWeights(weights, status)


def weights_of(scale: Scale, brackets: Brackets) -> FloatArray:
    """Lay brackets on a scale out as weights of the group's maps.

    Returns
    -------
    ndarray, shape (n, M)
        Rows sum to 1; NaN where the temperature is not known.
    """
    return of_two_maps(scale, brackets.lower, 1.0 - brackets.weight, brackets.weight)


def of_two_maps(
    scale: Scale, lower: IntArray, of_lower: FloatArray, of_upper: FloatArray
) -> FloatArray:
    """Lay out how much of two neighbours on a scale enters as weights of the group's maps.

    Parameters
    ----------
    lower : ndarray, shape (n,)
        Place of the lower one on the scale.
    of_lower, of_upper : ndarray, shape (n,)
        How much of each; NaN where that is not known.

    Returns
    -------
    ndarray, shape (n, M)
        NaN in all of a row where it is not known.
    """
    rows = np.array(scale.rows, dtype=np.intp)
    weights = np.zeros((len(lower), rows.size))
    each = np.arange(len(lower))
    weights[each, rows[lower]] = of_lower
    weights[each, rows[lower + 1]] = of_upper
    unknown = np.isnan(of_upper)
    if unknown.any():
        weights[unknown] = np.nan
    return weights


def added(first: FloatArray, other: FloatArray) -> FloatArray:
    """Add weights up; a map that cancels does not enter.

    Parameters
    ----------
    first, other : ndarray, shape (n, M)

    Returns
    -------
    ndarray, shape (n, M)
    """
    total = first + other
    total[np.abs(total) <= ROUNDING] = 0.0
    return total


def common_ranges(member: Member, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Find the positions that all maps that enter have in common.

    Parameters
    ----------
    weights : ndarray, shape (n, M)
        A map of weight 0 does not enter.

    Returns
    -------
    low, high : ndarray, shape (n,) [mm]
        −∞ and ∞ where none depends on position; low ≥ high where they have none.
    """
    lows, highs = member.ranges_mm.T
    if (lows == lows[0]).all() and (highs == highs[0]).all():
        n = len(weights)
        return np.full(n, lows[0]), np.full(n, highs[0])
    enters = weights != 0.0
    return (
        np.where(enters, lows, -np.inf).max(axis=1),
        np.where(enters, highs, np.inf).min(axis=1),
    )


def read_maps(
    group: Group,
    member: Member,
    weights: FloatArray,
    positions_mm: FloatArray,
    directions: FloatArray,
) -> FloatArray:
    """Add up the maps of one component at positions.

    Parameters
    ----------
    weights : ndarray, shape (n, M), or (1, M) for all positions
        How much of each map.
    positions_mm : ndarray, shape (n,) [mm]
        Ignored where the component has no argument. Outside what all maps that enter cover, the
        end values of that range hold.
    directions : ndarray, shape (n,)
        +1 or −1 for the direction of approach, 0 where unknown (the mean of both).

    Returns
    -------
    ndarray, shape (n,) [the component's unit]
        NaN where a weight is, and where the maps that enter have no range in common.
    """
    low, high = common_ranges(member, weights)
    weights = np.broadcast_to(weights, (len(positions_mm), weights.shape[1]))
    left, right, share = hat_weights(member.positions_mm, np.clip(positions_mm, low, high))
    values = np.zeros(len(positions_mm))
    for row in range(weights.shape[1]):
        rows = np.flatnonzero(weights[:, row])
        if not rows.size:
            continue
        at = (left[rows], right[rows], share[rows])
        values[rows] += weights[rows, row] * _of_map(group, member, row, at, directions[rows])
    return np.where(low < high, values, np.nan)


def maps_at_places(
    group: Group, member: Member, positions_mm: FloatArray, directions: FloatArray
) -> FloatArray | None:
    """Read each map of one component at positions: what `read_maps` adds up.

    Who reads the same places with many weights reads them once.

    Parameters
    ----------
    positions_mm, directions
        As for `read_maps`.

    Returns
    -------
    ndarray, shape (n, M) [the component's unit], or None
        None where that depends on the weights: on which maps enter, where they cover different
        ranges, or on whether any does, where a position is not known.
    """
    low, high = member.ranges_mm.T
    if (low != low[0]).any() or (high != high[0]).any() or low[0] >= high[0]:
        return None
    beside = hat_weights(member.positions_mm, np.clip(positions_mm, low[0], high[0]))
    per_map = [_of_map(group, member, row, beside, directions) for row in range(len(low))]
    values = np.stack(per_map, axis=1)
    return values if np.isfinite(values).all() else None


def _of_map(
    group: Group,
    member: Member,
    row: int,
    beside: tuple[IntArray, IntArray, FloatArray],
    directions: FloatArray,
) -> FloatArray:
    """Read one map between nodes (`hat_weights`), on the side that was come from."""
    values = _between(group.nodes[row, member.forward], *beside)
    if member.backward is None:
        return values
    back = _between(group.nodes[row, member.backward], *beside)
    both = np.where(directions < 0, back, (values + back) / 2)
    return np.where(directions > 0, values, both)


def _between(nodes: FloatArray, left: IntArray, right: IntArray, share: FloatArray) -> FloatArray:
    values: FloatArray = (1.0 - share) * nodes[left] + share * nodes[right]
    return values
