"""What a model says at many times and places: the table, asked point by point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from app.arrays import FloatArray
from app.errors import InvalidContent, NotEnoughMaps, OutsideMaps, list_names
from app.geometry.components import LINEAR_LETTERS, ORDER
from app.geometry.volumetric_error import volumetric_error
from app.thermal.bracket import Status
from app.thermal.compiled_model import CompiledModel, Group, Member, common_range_of_rows

NO_READING = "no-reading"
OUTSIDE_MAPS = "outside-maps"
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


@dataclass(frozen=True, slots=True)
class _Brackets:
    """A group's neighbouring rows and weight at each of n times."""

    lower: np.ndarray[tuple[int], np.dtype[np.intp]]
    upper: np.ndarray[tuple[int], np.dtype[np.intp]]
    weight: FloatArray
    status: list[str]


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
    model
        The compiled model.
    code
        Component code.
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
    found = model.find(code)
    if found is None:
        have = sorted((c for group in model.groups for c in group.codes), key=ORDER.__getitem__)
        raise InvalidContent(
            f"expected a component of the model ({list_names(have)}), "
            f"came {code}: {model.omitted.get(code, 'no map has it')}"
        )
    group, member = found
    brackets = _brackets(model, group, temperatures_c, len(positions_mm))
    return Predicted(
        _values(group, member, brackets, positions_mm, directions),
        brackets.status,
        tuple(_beyond(member, brackets, positions_mm)),
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
    model, temperatures_c
        As for `predict_component`.
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
        brackets = _brackets(model, group, temperatures_c, len(points_mm))
        statuses.append(brackets.status)
        for member in group.members:
            axis = member.component.axis
            row = LINEAR_LETTERS.index(axis) if axis else 0
            errors[member.component.code] = _values(
                group, member, brackets, points_mm[:, row], directions[:, row]
            )
            beyond += _beyond(member, brackets, points_mm[:, row])
    values, _ = volumetric_error(
        model.machine.chain, errors, points_mm, tool_offsets_mm, model.measuring_lines
    )
    worst = [max(row, key=GRAVITY.index) for row in zip(*statuses, strict=True)]
    # Also where the unknown component happens to have no lever at this point.
    values[[status in (OUTSIDE_MAPS, NO_READING) for status in worst]] = np.nan
    return Predicted(values, worst, tuple(beyond))


def _brackets(
    model: CompiledModel, group: Group, temperatures_c: Mapping[str, FloatArray], n: int
) -> _Brackets:
    lower = np.zeros(n, dtype=np.intp)
    upper = np.zeros(n, dtype=np.intp)
    weight = np.full(n, np.nan)
    status: list[str] = [NO_READING] * n
    for i in range(n):
        here = {
            s.sensor: float(temperatures_c[s.sensor][i])
            for s in group.scales
            if s.sensor in temperatures_c and not np.isnan(temperatures_c[s.sensor][i])
        }
        scale = group.usable_scale(here)
        if scale is None:
            continue
        try:
            bracket = model.bracket(group, scale, here[scale.sensor])
        except OutsideMaps:
            status[i] = OUTSIDE_MAPS
            continue
        lower[i] = scale.rows[bracket.lower]
        upper[i] = scale.rows[bracket.lower + 1]
        weight[i] = bracket.weight
        status[i] = bracket.status
    return _Brackets(lower, upper, weight, status)


def _values(
    group: Group,
    member: Member,
    brackets: _Brackets,
    positions_mm: FloatArray,
    directions: FloatArray,
) -> FloatArray:
    forward = _in_table(group, member, member.forward, brackets, positions_mm)
    if member.backward is None:
        return forward
    backward = _in_table(group, member, member.backward, brackets, positions_mm)
    return np.where(
        directions > 0, forward, np.where(directions < 0, backward, (forward + backward) / 2)
    )


def _in_table(
    group: Group,
    member: Member,
    columns: slice,
    brackets: _Brackets,
    positions_mm: FloatArray,
) -> FloatArray:
    """Interpolate over temperature and position together: shape (n,)."""
    table = group.nodes[:, columns]
    grid = member.positions_mm
    # Beyond what the maps in use cover, the end values of that range hold.
    positions_mm = np.clip(positions_mm, *_range(member, brackets))
    if grid.size < 2:
        left = right = np.zeros(len(brackets.weight), dtype=np.intp)
        share = np.zeros(len(brackets.weight))
    else:
        inside = np.clip(positions_mm, grid[0], grid[-1])
        left = np.clip(np.searchsorted(grid, inside, side="right") - 1, 0, grid.size - 2)
        right = left + 1
        share = (inside - grid[left]) / (grid[right] - grid[left])
    w = brackets.weight
    at_left = (1 - w) * table[brackets.lower, left] + w * table[brackets.upper, left]
    at_right = (1 - w) * table[brackets.lower, right] + w * table[brackets.upper, right]
    return (1 - share) * at_left + share * at_right


def _range(member: Member, brackets: _Brackets) -> tuple[FloatArray, FloatArray]:
    """Find what the maps in use cover of a component: shape (n,) [mm]."""
    w = brackets.weight
    lower = np.where(w == 1.0, brackets.upper, brackets.lower)
    upper = np.where(w == 0.0, brackets.lower, brackets.upper)
    return common_range_of_rows(member.ranges_mm, lower, upper)


def _beyond(member: Member, brackets: _Brackets, positions_mm: FloatArray) -> list[BeyondTables]:
    low, high = _range(member, brackets)
    there = ((positions_mm < low) | (positions_mm > high)) & ~np.isnan(brackets.weight)
    if not there.any():
        return []
    ranges = np.unique(np.column_stack([low[there], high[there]]), axis=0)
    return [
        BeyondTables(
            member.component.code,
            int(np.count_nonzero(there)),
            tuple((float(a), float(b)) for a, b in ranges),
        )
    ]
