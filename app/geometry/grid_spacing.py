"""How fine an evenly spaced grid must be for a controller that interpolates trilinearly.

Interpolation along one axis, I_u, is an average, so with e the model

    ‖I_x I_y I_z e − e‖ ≤ ‖I_x e − e‖ + ‖I_y e − e‖ + ‖I_z e − e‖,

and where y and z stand at nodes the left side is ‖I_x e − e‖ alone. What each axis
leaves by itself therefore bounds what the grid leaves, from above by the sum and from
below by the largest. A finer grid is not always better: one whose nodes are the
tables' leaves less than a finer one that misses them. So no search by halving is
sound; every number of intervals is looked at on each axis, which is cheap, and the
grid itself is judged by `grid_difference`, whose bound is proven.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray, IntArray
from app.errors import InvalidContent
from app.geometry.components import COMPONENTS, LINEAR_LETTERS
from app.geometry.error_field import ErrorField
from app.geometry.grid import ErrorGrid, sample_grid
from app.geometry.grid_difference import (
    errors_on,
    grid_difference,
    interpolate_along,
    with_length,
)
from app.geometry.polynomial_pieces import bernstein_coefficients, cut, degree_along
from app.geometry.volumetric_error import NO_TOOL
from app.geometry.work_volume import WorkVolume, points_of

Counts: TypeAlias = tuple[int, int, int]

MOST_INTERVALS: Final = 1000
"""More on one axis are not tried: no controller has so many grid points."""


@dataclass(frozen=True, slots=True)
class GridSpacing:
    """An evenly spaced grid that keeps a tolerance.

    Parameters
    ----------
    bound_um
        Length of vector that the difference between interpolation and model exceeds
        nowhere in the volume [µm].
    attained_um
        A difference that does occur [µm].
    """

    intervals: Counts
    spacing_mm: tuple[float, float, float]
    bound_um: float
    attained_um: float

    @property
    def points(self) -> int:
        """Number of grid points."""
        i, j, k = self.intervals
        return (i + 1) * (j + 1) * (k + 1)


def spacing_for_tolerance(
    field: ErrorField,
    volume: WorkVolume,
    tolerance_um: float,
    tool_offset_mm: ArrayLike = NO_TOOL,
    most_intervals: int = 100,
) -> GridSpacing:
    """Find the coarsest evenly spaced grid whose interpolation stays within a tolerance.

    Parameters
    ----------
    tolerance_um
        Largest length of the difference between trilinear interpolation and model
        that is accepted anywhere in the box [µm].
    tool_offset_mm : array-like, shape (3,) [mm]

    Returns
    -------
    GridSpacing
        The tolerance is kept for certain (a proven bound, up to rounding), and no one
        axis can have fewer intervals while the others stay: the spacing is the
        largest of each axis.

    Raises
    ------
    InvalidContent
        If no grid of at most so many intervals keeps the tolerance, or none is found.

    Notes
    -----
    Starts from the grid of fewest points for which the sum of what the three axes
    leave is within the tolerance, and coarsens one axis after the other.
    """
    _check(field, volume, tolerance_um, most_intervals)
    tool = np.asarray(tool_offset_mm, dtype=np.float64)
    residuals = [
        _left_by_axis(field, volume, i, tool, tolerance_um, most_intervals) for i in range(3)
    ]
    possible = [np.flatnonzero(rows[:, 1] <= tolerance_um) + 1 for rows in residuals]
    for axis, counts, rows in zip(LINEAR_LETTERS, possible, residuals, strict=True):
        if not counts.size:
            raise _impossible(axis, tolerance_um, rows)
    intervals = _fewest_points([rows[:, 0] for rows in residuals], tolerance_um)

    def judge(counts: Counts) -> GridSpacing:
        bounds = [rows[count - 1, 0] for rows, count in zip(residuals, counts, strict=True)]
        return _judged(field, volume, counts, tool, float(sum(bounds)), tolerance_um)

    spacing = judge(intervals)
    if spacing.bound_um > tolerance_um:
        raise InvalidContent.of_field(
            "tolerance_um",
            f"expected a tolerance in µm for which a grid of at most {most_intervals} intervals "
            f"per axis is found, got {tolerance_um:g} µm: the best one, {intervals}, leaves "
            f"{spacing.attained_um:.3g} µm somewhere",
        )
    return _coarsened(spacing, possible, judge, tolerance_um)


def _check(field: ErrorField, volume: WorkVolume, tolerance_um: float, most_intervals: int) -> None:
    field.expect_one_state()
    if not (math.isfinite(tolerance_um) and tolerance_um > 0):
        raise InvalidContent.of_field(
            "tolerance_um", f"expected a tolerance above 0 µm, got {tolerance_um:g} µm"
        )
    if not 1 <= most_intervals <= MOST_INTERVALS:
        raise InvalidContent.of_field(
            "most_intervals", f"expected 1 to {MOST_INTERVALS}, got {most_intervals}"
        )
    for letter, (low, high) in zip(LINEAR_LETTERS, volume.ranges_mm, strict=True):
        if not low < high:
            raise InvalidContent.of_field(
                f"{letter}_mm", f"expected a range in mm to divide, got {low:g} to {high:g} mm"
            )


def _left_by_axis(
    field: ErrorField,
    volume: WorkVolume,
    i: int,
    tool: FloatArray,
    tolerance_um: float,
    most_intervals: int,
) -> FloatArray:
    """What 1, 2, 3 … intervals on one axis leave by themselves: rows (bound, attained) [µm].

    Ends early where so little is left that more intervals are not worth their points.
    """
    rows: list[tuple[float, float]] = []
    across = [_across(field, volume, i, j) for j in range(3)]
    degrees = [degree_along(field, axis) for axis in LINEAR_LETTERS]
    # An axis that leaves a twentieth of the tolerance leaves the others nearly all of it: still
    # finer it would save hardly a point.
    while len(rows) < most_intervals and not (rows and rows[-1][0] <= tolerance_um / 20):
        nodes = np.linspace(*volume.ranges_mm[i], len(rows) + 2)
        coordinates = [*across]
        coordinates[i] = cut(nodes, field.nodes_mm(LINEAR_LETTERS[i]), degrees[i])
        errors = errors_on(field, tuple(coordinates), tool)
        # `cut` keeps the nodes to the last bit, so that the search meets each of them exactly.
        at_nodes = errors.take(np.searchsorted(coordinates[i], nodes), axis=i)
        difference = interpolate_along(at_nodes, i, nodes, coordinates[i]) - errors
        bound = with_length(bernstein_coefficients(difference, degrees))[..., 3].max()
        rows.append((float(bound), float(with_length(_at_nodes(difference, i))[..., 3].max())))
    return np.array(rows)


def _at_nodes(difference: FloatArray, i: int) -> FloatArray:
    """Keep the ends of the other two coordinates, which are nodes of every grid."""
    for j in range(3):
        if j != i:
            difference = difference.take([0, -1], axis=j)
    return difference


def _across(field: ErrorField, volume: WorkVolume, i: int, j: int) -> FloatArray:
    """Coordinates j at which what axis i leaves must be looked at.

    What is linear in coordinate i is interpolated without a difference. The rest is a
    function of i times 1, j or j², so the ends of j (and its middle) tell it all; only a
    rotation of axis j that grows with i and has i as its arm brings in j's tables.
    """
    mixes = any(
        COMPONENTS[code].is_rotation
        and COMPONENTS[code].axis == LINEAR_LETTERS[j]
        and COMPONENTS[code].times == LINEAR_LETTERS[i]
        for code in field.tables
    )
    tables_mm = field.nodes_mm(LINEAR_LETTERS[j]) if mixes else np.empty(0)
    ends = np.array(volume.ranges_mm[j])
    return cut(ends, tables_mm, degree_along(field, LINEAR_LETTERS[j]))


def _fewest_points(bounds_um: Sequence[FloatArray], tolerance_um: float) -> Counts:
    """Find the fewest grid points whose three bounds add up to the tolerance.

    Where none do, the finest of each axis.
    """
    x, y, z = bounds_um
    best, fewest = None, math.inf
    # What the smallest of so many intervals leaves falls with their number.
    least = np.minimum.accumulate(z)
    for i, left_x in enumerate(x):
        rest = tolerance_um - left_x - y
        # The first place where the falling `least` is at most the rest; there `z` itself is, for it
        # has just fallen to it.
        k = np.searchsorted(-least, -rest)
        points = np.where(k < z.size, (i + 2) * (np.arange(y.size) + 2) * (k + 2), np.inf)
        j = int(np.argmin(points))
        if points[j] < fewest:
            best, fewest = (i + 1, j + 1, int(k[j]) + 1), float(points[j])
    if best is None:
        return (int(np.argmin(x)) + 1, int(np.argmin(y)) + 1, int(np.argmin(z)) + 1)
    return best


def _judged(
    field: ErrorField,
    volume: WorkVolume,
    counts: Counts,
    tool: FloatArray,
    sum_um: float,
    tolerance_um: float,
) -> GridSpacing:
    """Bound what a grid leaves: by itself, or by the sum of its axes where that is less.

    Where it is seen to be beyond the tolerance, that it is beyond must do for a bound.
    """
    x, y, z = (
        np.linspace(low, high, count + 1)
        for (low, high), count in zip(volume.ranges_mm, counts, strict=True)
    )
    grid = sample_grid(field, x, y, z, tool)
    bound_um = attained_um = _left_in_the_middles(field, grid, tool)
    # The bound looks at many points of each cell, and most grids fail in the middles already.
    if attained_um <= tolerance_um:
        residual = grid_difference(field, grid, tool)
        bound_um = min(residual.largest_um, sum_um)
        attained_um = float(residual.attained_length_um.max())
    return GridSpacing(
        intervals=counts,
        spacing_mm=(float(x[1] - x[0]), float(y[1] - y[0]), float(z[1] - z[0])),
        bound_um=bound_um,
        attained_um=attained_um,
    )


def _left_in_the_middles(field: ErrorField, grid: ErrorGrid, tool: FloatArray) -> float:
    """The largest difference in the cells' middles [µm]: enough to turn most grids down."""
    middles = points_of(*((nodes[:-1] + nodes[1:]) / 2 for nodes in grid.nodes_mm))
    errors_um, _ = field.at(middles, tool)
    return float(with_length(grid.at(middles) - errors_um)[:, 3].max())


def _coarsened(
    spacing: GridSpacing,
    possible: Sequence[IntArray],
    judge: Callable[[Counts], GridSpacing],
    tolerance_um: float,
) -> GridSpacing:
    """Take the fewest intervals on one axis after the other until no axis can have fewer."""
    changed = True
    while changed:
        changed = False
        for i, counts in enumerate(possible):
            # From the fewest on, none left out: what a grid leaves need not fall with every
            # interval more.
            for fewer in counts[counts < spacing.intervals[i]]:
                x, y, z = (int(fewer) if i == j else n for j, n in enumerate(spacing.intervals))
                trial = judge((x, y, z))
                if trial.bound_um <= tolerance_um:
                    spacing, changed = trial, True
                    break
    return spacing


def _impossible(axis: str, tolerance_um: float, rows: FloatArray) -> InvalidContent:
    best = int(np.argmin(rows[:, 1]))
    return InvalidContent.of_field(
        "tolerance_um",
        f"expected a tolerance in µm that a grid of at most {len(rows)} intervals per axis can "
        f"keep, got {tolerance_um:g} µm: along {axis} alone at least {rows[best, 1]:.3g} µm "
        f"are left ({best + 1} intervals)",
    )
