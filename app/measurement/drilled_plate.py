"""Errors in a plane from holes that the machine drilled, measured on a coordinate machine.

Each hole is where the machine put the tool when it was told the nominal position. How
the plate lay on the coordinate machine is unknown, so a rigid motion is fitted and taken
out (two-dimensional Procrustes, exact rotation). What remains holds scale, squareness
and, where rows and columns of holes repeat, the errors of each axis:

    e_x = EXX(x) + EXY(y) + SXY·y,    e_y = EYX(x) + EYY(y)

References
----------
C. Wang, 8.58–8.60 for the sign of SXY: E_x gains SXY·y.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from app.answer import AS_IT_IS
from app.arrays import FloatArray, rms_length
from app.errors import InvalidContent, list_names
from app.geometry.components import COMPONENTS
from app.geometry.measuring_line import MeasuringLines
from app.measurement.outliers import far_holes
from app.measurement.plane_errors import (
    AffineFit,
    GridFit,
    RigidMotion,
    fit_rows_and_columns,
    fit_scale_and_squareness,
    take_out_rigid_motion,
)
from app.measurement.reference_line import covariance_through, slope_weights, without_line
from app.measurement.result import Evaluated, MeasurementResult
from app.measurement.stated_numbers import FARTHEST_MM, as_numbers, as_point, as_standard_deviation
from app.measurement.stated_runs import stated_line
from app.rounding import Micro, listed, to_digits_of
from app.thermal.error_map import ComponentTable
from app.units import MM_PER_M, UM_PER_MM

FEWEST_HOLES: Final = 3
MOST_NAMED: Final = 10
LARGEST_EXPANSION: Final = 100.0
LARGEST_DIFFERENCE_C: Final = 100.0


@dataclass(frozen=True, eq=False, kw_only=True)
class DrilledPlate(Evaluated):
    """Scale, squareness and axis errors, up to a rigid motion.

    EXX, EYY and SXY; EXY and EYX too where rows and columns repeat.
    """

    rotation_urad: Micro
    """How the plate lay on the coordinate machine, about Z [µrad]"""
    shift_mm: Annotated[FloatArray, listed(1, write=to_digits_of)]
    """Where its nominal zero lay [mm]"""
    scale_um_per_m: Annotated[FloatArray, listed(1)]
    """Scale of x and y [µm/m]"""
    scale_standard_errors_um_per_m: Annotated[FloatArray, listed(1, float | None, to_digits_of)]
    """Their standard errors [µm/m]"""
    squareness_um_per_m: Micro
    """SXY [µm/m]"""
    # Of the holes without the rigid motion, shape (n, 2) [µm].
    errors_um: Annotated[FloatArray, AS_IT_IS, Field(exclude=True)]
    residuals_um: Annotated[FloatArray, listed(2)]
    """What rigid motion, scale and squareness leave of each hole's x, y [µm]"""
    suspicious: Sequence[int]
    """Indices of holes far from the rest, from 0; they are kept"""


def evaluate_drilled_plate(
    nominal_mm: ArrayLike,
    measured_mm: ArrayLike,
    *,
    origin_mm: ArrayLike | None = None,
    tool_offset_mm: ArrayLike = (0.0, 0.0, 0.0),
    expansion_um_per_m_k: float = 0.0,
    drilled_minus_measured_c: float = 0.0,
    repeatability_um: float | None = None,
) -> DrilledPlate:
    """Take scale, squareness and axis errors from the holes of a plate.

    Parameters
    ----------
    nominal_mm, measured_mm : array-like, shape (n, 2) [mm]
        Nominal and measured x, y of the same holes, at least three, not on one line.
    origin_mm : array-like, shape (3,), optional [mm]
        Machine position at the plate's nominal zero; tables then count from the machine's
        zero and their measuring lines are stated.
    tool_offset_mm : array-like, shape (3,) [mm]
        Tool offset with which it was drilled.
    expansion_um_per_m_k
        The plate's coefficient of expansion [µm/(m K)].
    drilled_minus_measured_c
        The plate's temperature when it was drilled minus when it was measured [°C].
    repeatability_um
        Standard deviation of one coordinate of a hole [µm], used where the holes leave no
        degree of freedom.

    Raises
    ------
    InvalidContent
        If holes are too few, on one line, or numbers are missing, not finite, or so far
        from nominal that holes are mixed up, mirrored or in another unit.

    Notes
    -----
    Covariances are σ² times those of the least-squares fit; σ is estimated for x and for
    y from what the fit leaves. A plate that was warmer when it was drilled has shrunk:
    the measured positions are enlarged by expansion · temperature difference.

    Examples
    --------
    >>> nominal = [[0, 0], [200, 0], [0, 100], [200, 100]]
    >>> measured = [[0, 0], [200.004, 0], [0.001, 100], [200.005, 100]]
    >>> plate = evaluate_drilled_plate(nominal, measured)
    >>> plate.scale_um_per_m.round(3).tolist(), round(plate.squareness_um_per_m, 3)
    ([20.0, 0.0], 10.0)
    """
    nominal = _as_holes("nominal_mm", nominal_mm)
    measured = _as_holes("measured_mm", measured_mm)
    _expect_the_same_holes(nominal, measured)
    growth = _growth(expansion_um_per_m_k, drilled_minus_measured_c)
    spread = as_standard_deviation("repeatability_um", repeatability_um, "µm")
    origin = None if origin_mm is None else as_point("origin_mm", origin_mm)
    tool = as_point("tool_offset_mm", tool_offset_mm)
    # Enlarged about the coordinate machine's zero, wherever that is: what it shifts the plate by
    # goes out with the rigid motion.
    rigid = take_out_rigid_motion(nominal, measured * (1 + growth / (UM_PER_MM * MM_PER_M)))
    grid = fit_rows_and_columns(nominal, rigid.errors_um)
    affine = fit_scale_and_squareness(nominal, rigid.errors_um, grid, spread)
    suspicious = far_holes(affine.residuals_um)
    squareness = squareness_of(rigid.errors_um, affine, grid)
    before = rms_length((measured - nominal) * UM_PER_MM)
    tables = axis_tables(nominal, rigid.errors_um, affine, grid, origin)
    return DrilledPlate(
        rotation_urad=rigid.rotation_urad,
        shift_mm=rigid.shift_mm,
        scale_um_per_m=affine.scale_um_per_m,
        scale_standard_errors_um_per_m=affine.scale_standard_errors_um_per_m,
        squareness_um_per_m=squareness.value,
        errors_um=rigid.errors_um,
        residuals_um=affine.residuals_um,
        suspicious=suspicious,
        result=MeasurementResult(
            tables=(*tables, squareness.table),
            figures=_figures_of_holes(before, rigid, affine) | _figures(affine, squareness, grid),
            notes=_notes(affine, grid, growth, suspicious),
            measuring_lines=plate_lines(nominal, grid, origin, tool),
        ),
    )


def _as_holes(field: str, stated_mm: ArrayLike) -> FloatArray:
    holes = as_numbers(field, stated_mm, "mm", FARTHEST_MM, "perhaps in µm")
    if holes.ndim != 2 or holes.shape[1] != 2 or len(holes) < FEWEST_HOLES:
        raise InvalidContent.of_field(
            field,
            f"expected x and y of at least {FEWEST_HOLES} holes in mm, got an array of shape "
            f"{holes.shape}",
        )
    return holes


def _expect_the_same_holes(nominal: FloatArray, measured: FloatArray) -> None:
    if len(nominal) != len(measured):
        raise InvalidContent.of_field(
            "measured_mm", f"expected {len(nominal)} holes as nominal, got {len(measured)}"
        )
    wide, narrow = np.linalg.svd(nominal - nominal.mean(axis=0), compute_uv=False)
    if narrow <= 1e-6 * wide:
        raise InvalidContent.of_field(
            "nominal_mm", "expected holes that span a plane, got holes on one line"
        )


def _growth(expansion_um_per_m_k: float, difference_c: float) -> float:
    """How much longer the plate was when it was drilled [µm/m]."""
    for field, value, largest, unit in (
        ("expansion_um_per_m_k", expansion_um_per_m_k, LARGEST_EXPANSION, "µm/(m K)"),
        ("drilled_minus_measured_c", difference_c, LARGEST_DIFFERENCE_C, "°C"),
    ):
        if not abs(value) <= largest:
            raise InvalidContent.of_field(
                field, f"expected a number within ±{largest:g} {unit}, got {value:g} {unit}"
            )
    return expansion_um_per_m_k * difference_c


def _figures_of_holes(
    rms_before_um: float, rigid: RigidMotion, affine: AffineFit
) -> dict[str, float]:
    return {
        "holes": float(len(rigid.errors_um)),
        "rms_before_um": rms_before_um,
        "rms_without_rigid_motion_um": rms_length(rigid.errors_um),
        "rms_without_scale_and_squareness_um": rms_length(affine.residuals_um),
        "rotation_urad": rigid.rotation_urad,
        "shift_x_mm": float(rigid.shift_mm[0]),
        "shift_y_mm": float(rigid.shift_mm[1]),
    }


def _figures(affine: AffineFit, squareness: Squareness, grid: GridFit | None) -> dict[str, float]:
    figures = {"SXY_um_per_m": squareness.value}
    for u, scale in zip("xy", affine.scale_um_per_m, strict=True):
        figures[f"scale_{u}_um_per_m"] = float(scale)
    if grid is not None:
        figures["rms_without_rows_and_columns_um"] = rms_length(grid.residuals_um)
    if np.isnan(affine.noise_um).any():
        return figures
    figures["SXY_standard_error_um_per_m"] = squareness.standard_error
    for i, u in enumerate("xy"):
        standard_error = float(affine.scale_standard_errors_um_per_m[i])
        figures[f"scale_{u}_standard_error_um_per_m"] = standard_error
        figures[f"noise_{u}_um"] = float(affine.noise_um[i])
    figures["noise_degrees_of_freedom"] = float(affine.degrees_of_freedom)
    return figures


def _notes(
    affine: AffineFit, grid: GridFit | None, growth: float, suspicious: tuple[int, ...]
) -> tuple[str, ...]:
    notes = [
        "Scale is the machine's and the plate's together: a plate 1 K warmer when drilled than "
        "when measured reads small by its coefficient of expansion (steel about 12 µm/m, "
        f"aluminium about 23 µm/m). Corrected by {growth:g} µm/m."
    ]
    if grid is None:
        notes.append(
            "Too few holes share rows and columns: EXX and EYY are straight lines, and "
            "straightness is not told apart. The standard errors take what is left as random; "
            "holes that err as their neighbours do make the true ones larger."
        )
    if np.isnan(affine.noise_um).any():
        notes.append("No degree of freedom is left for the noise: there are no standard errors.")
    if suspicious:
        named = list_names(map(str, suspicious), MOST_NAMED)
        notes.append(f"Suspicious holes, far from the rest and kept: index {named}.")
    return tuple(notes)


class Squareness(NamedTuple):
    """SXY and its standard error [µm/m]."""

    value: float
    standard_error: float

    @property
    def table(self) -> ComponentTable:
        """The component; without uncertainty where nothing is known of the noise."""
        is_determined = not math.isnan(self.standard_error)
        covariance = [[self.standard_error**2]] if is_determined else None
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
        # A rotation by φ is e_x = −φ y and e_y = φ x: in the sum of the slopes there is none of it.
        slope = affine.slopes[0, 1] + affine.slopes[1, 0]
        # The slope of e_x is that along y, with the noise of x, and the other way round.
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
