"""Components of the machine from the errors of a plate's holes, and the lines they belong to."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from app.arrays import FloatArray
from app.geometry.components import COMPONENTS
from app.geometry.measuring_line import MeasuringLines
from app.measurement.reference_line import covariance_through, slope_weights, without_line
from app.measurement.rows_and_columns import GridFit
from app.measurement.scale_and_squareness import AffineFit
from app.measurement.stated_axes import stated_line
from app.thermal.error_map import ComponentTable
from app.units import MM_PER_M


class Squareness(NamedTuple):
    """SXY and its standard error [µm/m]."""

    value: float
    standard_error: float

    @property
    def table(self) -> ComponentTable:
        """The component; without uncertainty where nothing is known of the noise."""
        known = not math.isnan(self.standard_error)
        covariance = [[self.standard_error**2]] if known else None
        return ComponentTable.make(COMPONENTS["SXY"], self.value, covariance=covariance)


def axis_tables(
    nominal_mm: FloatArray,
    errors_um: FloatArray,
    affine: AffineFit,
    grid: GridFit | None,
    origin_mm: FloatArray | None,
) -> tuple[ComponentTable, ...]:
    """Make the tables of displacement and straightness along x and y.

    Parameters
    ----------
    nominal_mm, errors_um : ndarray, shape (n, 2) [mm; µm]
        Nominal x, y of the holes and their errors.
    affine, grid
        The fits; without rows and columns EXX and EYY are straight lines.
    origin_mm : ndarray, shape (3,), optional [mm]
        Machine position at the plate's nominal zero.

    Returns
    -------
    tuple of ComponentTable
    """
    from_mm = np.zeros(3) if origin_mm is None else origin_mm
    if grid is None:
        return tuple(_scale_table(nominal_mm, affine, u, float(from_mm[u])) for u in (0, 1))
    return tuple(
        _grid_table(errors_um, grid, way, u, float(from_mm[u]))
        for way, u in ((0, 0), (1, 0), (0, 1), (1, 1))
        if way == u or grid.coordinates_mm[u].size > 2
    )


def squareness_of(errors_um: FloatArray, affine: AffineFit, grid: GridFit | None) -> Squareness:
    """Add the slope of e_x along y and that of e_y along x.

    Parameters
    ----------
    errors_um : ndarray, shape (n, 2) [µm]
        Errors of the holes.
    affine, grid
        The fits; rows and columns decide where there are some.

    Returns
    -------
    Squareness
        A rotation adds to one slope what it takes from the other.
    """
    if grid is None:
        slope = affine.slopes[0, 1] + affine.slopes[1, 0]
        along = np.diagonal(affine.unit_covariance)[::-1]
        of_slope = math.sqrt(float(affine.noise_um**2 @ along))
        return Squareness(float(slope) * MM_PER_M, of_slope * MM_PER_M)
    value, variance = 0.0, 0.0
    for way, u in ((0, 1), (1, 0)):
        weights = slope_weights(grid.coordinates_mm[u], "least-squares") * MM_PER_M
        of_hole = weights @ grid.operators[u]
        value += float(of_hole @ errors_um[grid.holes, way])
        variance += float(grid.noise_um[way] ** 2 * of_hole @ of_hole)
    return Squareness(value, math.sqrt(variance))


def plate_lines(
    nominal_mm: FloatArray, grid: GridFit | None, origin_mm: FloatArray | None, tool_mm: FloatArray
) -> MeasuringLines:
    """Give the lines to which means over rows and columns belong: through the plate's middle.

    Parameters
    ----------
    nominal_mm : ndarray, shape (n, 2) [mm]
        Nominal x, y of the holes.
    grid
        Fit of rows and columns, whose holes decide where the middle is.
    origin_mm : ndarray, shape (3,), optional [mm]
        Machine position at the plate's nominal zero; no lines without it.
    tool_mm : ndarray, shape (3,) [mm]
        Tool offset with which the plate was drilled.

    Returns
    -------
    dict of axis to MeasuringLine
    """
    if origin_mm is None:
        return {}
    used = nominal_mm if grid is None else nominal_mm[grid.holes]
    x, y = used.mean(axis=0) + origin_mm[:2]
    return {
        "x": stated_line("x", [origin_mm[0], y, origin_mm[2]], tool_mm, "origin_mm"),
        "y": stated_line("y", [x, origin_mm[1], origin_mm[2]], tool_mm, "origin_mm"),
    }


def _scale_table(nominal: FloatArray, affine: AffineFit, u: int, from_mm: float) -> ComponentTable:
    """EXX or EYY as a straight line over the plate."""
    ends = np.array([nominal[:, u].min(), nominal[:, u].max()])
    arm = ends - nominal[:, u].mean()
    variance = affine.noise_um[u] ** 2 * affine.unit_covariance[u, u]
    covariance = None if math.isnan(variance) else variance * np.outer(arm, arm)
    component = COMPONENTS["EXX" if u == 0 else "EYY"]
    errors = affine.slopes[u, u] * arm
    return ComponentTable.make(component, errors, ends + from_mm, covariance=covariance)


def _grid_table(
    errors_um: FloatArray, grid: GridFit, way: int, u: int, from_mm: float
) -> ComponentTable:
    """E{way}{u} of columns or rows; a straightness without its least-squares line."""
    positions = grid.coordinates_mm[u]
    operator = grid.operators[u]
    if way != u:
        operator = without_line(positions, "least-squares") @ operator
    return ComponentTable.make(
        COMPONENTS[f"E{'XY'[way]}{'XY'[u]}"],
        operator @ errors_um[grid.holes, way],
        positions + from_mm,
        covariance=covariance_through(operator, float(grid.noise_um[way]) ** 2),
    )
