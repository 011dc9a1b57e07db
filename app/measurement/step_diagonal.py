"""Sequential step diagonals: twelve sets of errors from four set-ups of one laser.

C. Wang, *Laser vector measurement technique … Part I*, Rev. Sci. Instrum. 71, 3933 (2000),
[V]; C. Wang (2008), 8.3.2.2. A laser points along a body diagonal; the machine steps x,
then y, then z. The increment of each single step is the projection on the diagonal of
what the axis that moved did wrong, so that three or four diagonals tell its three
directions apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from app.answer import AS_IT_IS
from app.arrays import FloatArray
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, LINEAR_LETTERS
from app.geometry.error_field import ErrorField
from app.geometry.error_table import Table
from app.geometry.measuring_line import MeasuringLines
from app.geometry.volumetric_error import NO_TOOL
from app.measurement.reference_line import (
    StraightLine,
    covariance_through,
    slope_weights,
    without_line,
)
from app.measurement.result import Evaluated, MeasurementResult
from app.measurement.stated_runs import stated_line
from app.measurement.step_diagonal_input import (
    StepWalk,
    expect_angular,
    expect_options,
    expect_uncertainties,
    suspicions,
    take_walk,
)
from app.measurement.step_diagonal_notes import (
    blunders_in,
    notes_of_rotations,
    notes_of_uncertainty,
    translations_of,
)
from app.measurement.step_diagonal_readings import Target
from app.measurement.step_diagonal_uncertainty import (
    StepNoise,
    closure_um,
    mirror_in_squareness,
    neighbours_correlation,
    solution_of,
    step_noise,
    table_covariance,
    variance_of,
)
from app.rounding import listed
from app.thermal.error_map import ComponentTable
from app.units import MM_PER_M


@dataclass(frozen=True, eq=False, kw_only=True)
class StepDiagonal(Evaluated):
    """Nine translations and three squareness errors."""

    closure_um: Annotated[FloatArray, listed(2)] | None
    """For x, y, z and each interval: what the four diagonals contradict each other by, the
    measurement's own noise [µm]; null with three diagonals"""
    # Of the readings and of the mirrors, from which all uncertainty follows.
    noise: Annotated[StepNoise, AS_IT_IS, Field(exclude=True)]


def step_diagonal(
    chain: Chain,
    origin_mm: ArrayLike,
    step_mm: ArrayLike,
    diagonals: Mapping[str, ArrayLike],
    *,
    line: StraightLine = "end-points",
    angular: Mapping[str, Table] | None = None,
    tool_offset_mm: ArrayLike = NO_TOOL,
    target: Target = "point",
    repeatability_um: float | None = None,
    mirror_angle_urad: float | None = None,
    travel_mm: Mapping[str, tuple[float, float]] | None = None,
) -> StepDiagonal:
    """Derive translations and squareness from the readings on three or four diagonals.

    Parameters
    ----------
    origin_mm, step_mm : array-like, shape (3,) [mm]
        Lowest corner of the volume, and the positive steps X, Y, Z.
    diagonals : mapping of `ppp`, `npp`, `pnp`, `ppn` to array-like, shape (n, 3) [µm]
        Displacement along the diagonal since its start less its nominal, after x, after y
        and after z of each of n steps; positive where the machine went too far. The first
        axis of `npp` begins at its upper end.
    line
        Straightness counts from the line through its `end-points` or from its
        `least-squares` line; the lines' slopes make the squareness.
    angular
        Known angular errors, code (EAX …, or their slopes) to table [mm, µrad]: their
        effect is removed from the readings as far as it is none along the measuring lines.
    tool_offset_mm : array-like, shape (3,) [mm]
        Tool offset T of the target's middle.
    target
        `point` or `flat-mirror`, as for `step_diagonal_readings`; counts for `angular`.
    repeatability_um
        Standard deviation of one reading [µm], for where the closures give none.
    mirror_angle_urad
        Standard uncertainty of each of a mirror's two tilts against its diagonal [µrad];
        0 for a mirror that is no source of uncertainty. Left out, what the closures show.
    travel_mm
        Axis to the ends of its travel [mm], which the steps must not leave.

    Raises
    ------
    InvalidContent
        If a reading, a step, a diagonal or an option cannot be right.

    Notes
    -----
    Ordinary least squares from four diagonals has half the variance of [V 7–8], which use
    two at a time; three give the variance of [V 7–8] and no closure. Errors count from
    the lowest node of each axis, which is 0 by definition. The tables tell the volumetric
    error but for one displacement and one turn of the whole: straightness is what remains
    about its line, and of two lines' slopes only the sum is an error, SXY = slope of
    E_x(y) + slope of E_y(x) (likewise YZ, ZX). With four diagonals it is freed of tilted
    mirrors by what they leave in the closures, and is for end points the same as what the
    diagonals' ends alone say. [V 13] instead takes the scale errors for squareness.

    Examples
    --------
    >>> read = {"ppp": [[0.5, 0.5, 0.5]], "npp": [[0.5, 0.5, 0.5]], "pnp": [[0.5, 0.5, 0.5]]}
    >>> found = step_diagonal(Chain.parse("XYFZ"), [0, 0, 0], [30.0, 24.0, 32.0], read)
    >>> {t.component.code: t.errors.round(3).tolist()[-1] for t in found.result.tables[:4]}
    {'EXX': 0.833, 'EYX': 0.0, 'EZX': 0.0, 'EXY': 0.0}
    """
    expect_options(chain, line, target)
    expect_uncertainties(repeatability_um, mirror_angle_urad)
    walk, readings = take_walk(origin_mm, step_mm, diagonals, travel_mm)
    rotations = angular or {}
    expect_angular(rotations)
    lines = _measuring_lines(walk, tool_offset_mm)
    field = ErrorField.make(chain, rotations, lines)
    increments = walk.by_interval(readings - _seen_of(field, walk, tool_offset_mm, target))
    closure = closure_um(walk, increments) if len(walk.diagonals) > 3 else None
    noise = step_noise(walk, closure, repeatability_um, mirror_angle_urad)
    solution = solution_of(walk)
    tables = _tables(walk, increments, solution, noise, line)
    notes = (
        *suspicions(walk, readings),
        *([] if closure is None else blunders_in(walk, increments, closure)),
        translations_of(walk, lines, line),
        *notes_of_rotations(chain, rotations),
        *notes_of_uncertainty(walk, closure, noise, repeatability_um, mirror_angle_urad),
    )
    figures = _figures(walk, tables, closure, noise, solution)
    result = MeasurementResult(tables, figures, notes, lines)
    return StepDiagonal(result=result, closure_um=closure, noise=noise)


def _measuring_lines(walk: StepWalk, tool_offset_mm: ArrayLike) -> MeasuringLines:
    """Lines through the volume's centre: there the diagonals' lever arms cancel."""
    return {
        axis: stated_line(axis, walk.centre_mm, tool_offset_mm, "origin_mm")
        for axis in LINEAR_LETTERS
    }


def _seen_of(
    field: ErrorField, walk: StepWalk, tool_offset_mm: ArrayLike, target: Target
) -> FloatArray:
    """Project known errors on the diagonals at every reading: shape (m, n, 3) [µm]."""
    field.expect_one_state()
    positions = walk.positions_mm()
    offsets = np.broadcast_to(np.asarray(tool_offset_mm, dtype=np.float64), positions.shape)
    if target == "flat-mirror":
        # The beam does not follow the mirror sideways: it meets it beside its middle.
        since = positions - positions[:, :1]
        along = np.einsum("djv,dv->dj", since, walk.rays)[..., None] * walk.rays[:, None]
        offsets = offsets - since + along
    errors_um, _ = field.at(positions.reshape(-1, 3), offsets.reshape(-1, 3))
    along_um = np.einsum("djv,dv->dj", errors_um.reshape(positions.shape), walk.rays)
    # The laser was set to zero at the start: what the machine errs there, no reading has.
    seen: FloatArray = (along_um - along_um[:, :1])[:, 1:]
    return seen.reshape(len(walk.diagonals), walk.steps, 3)


def _tables(
    walk: StepWalk,
    increments: FloatArray,
    solution: FloatArray,
    noise: StepNoise,
    line: StraightLine,
) -> tuple[ComponentTable, ...]:
    """Sum the increments' three directions, and set the straightness lines' slopes apart."""
    moved = np.einsum("vd,dui->uvi", solution, increments)
    errors = np.pad(moved.cumsum(axis=2), ((0, 0), (0, 0), (1, 0)))
    nodes = np.arange(walk.steps + 1.0)
    # In steps, not mm: the operator that takes a line out does not depend on the unit. Slopes do,
    # and are divided by the step below.
    rest = without_line(nodes, line)
    tables = []
    for u, axis in enumerate(LINEAR_LETTERS):
        for v, direction in enumerate(LINEAR_LETTERS):
            covariance = table_covariance(walk, solution, noise, u, v)
            values = errors[u, v]
            if u != v:
                values = rest @ values
                covariance = None if covariance is None else covariance_through(rest, covariance)
            component = COMPONENTS[f"E{direction}{axis}".upper()]
            nodes_mm = walk.nodes_mm(axis)
            tables.append(ComponentTable.make(component, values, nodes_mm, covariance=covariance))
    slopes = [slope_weights(nodes, line) / step_m for step_m in walk.step_mm / MM_PER_M]
    return (*tables, *_squareness(walk, increments, solution, noise, slopes))


def _squareness(
    walk: StepWalk,
    increments: FloatArray,
    solution: FloatArray,
    noise: StepNoise,
    slopes: list[FloatArray],
) -> list[ComponentTable]:
    """Add the slopes of both straightness lines of each plane (8.58–8.60) [µm/m].

    Tilted mirrors add to the sum R/(2 UV) times what they add to the third axis' closures:
    without that, each squareness is a difference between two pairs of diagonals alone.
    """
    tables = []
    # An increment enters the errors of all nodes behind it.
    behind = [slope[:0:-1].cumsum()[::-1] for slope in slopes]
    for u, v, w in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        weights = np.zeros((len(walk.diagonals), 3, walk.steps))
        weights[:, u] = np.outer(solution[v], behind[u])
        weights[:, v] = np.outer(solution[u], behind[v])
        weights[:, w] = -np.outer(mirror_in_squareness(walk, w), behind[w])
        value = np.einsum("dui,dui->", weights, increments)
        variance = variance_of(walk, noise, weights)
        code = f"S{LINEAR_LETTERS[u]}{LINEAR_LETTERS[v]}".upper()
        covariance = None if variance is None else [[variance]]
        tables.append(ComponentTable.make(COMPONENTS[code], value, covariance=covariance))
    return tables


def _figures(
    walk: StepWalk,
    tables: tuple[ComponentTable, ...],
    closure: FloatArray | None,
    noise: StepNoise,
    solution: FloatArray,
) -> dict[str, float]:
    """Say how good the measurement is; figures that it cannot give are left out."""
    # The mean of all diagonals' ends: scales weighted with the squares of the steps.
    # Of nine tables, three for each axis, every fourth is the displacement: EXX, EYY, EZZ.
    end_errors = np.array([tables[4 * u].errors[-1] for u in range(3)])
    scale = walk.step_mm @ end_errors / (walk.steps * (walk.step_mm @ walk.step_mm)) * MM_PER_M
    freedom = noise.degrees_of_freedom
    figures: dict[str, float | None] = {
        "steps": float(walk.steps),
        "diagonals": float(len(walk.diagonals)),
        "diagonal_scale_um_per_m": float(scale),
        "reading_noise_um": noise.reading_um,
        "degrees_of_freedom": freedom if np.isfinite(freedom) else None,
        "mirror_angle_seen_urad": noise.seen_tilt_urad,
        "mirror_angle_hidden_urad": noise.hidden_tilt_urad,
    }
    if closure is not None:
        figures["closure_rms_um"] = float(np.sqrt((closure**2).mean()))
        figures["closure_neighbours_correlation"] = neighbours_correlation(closure)
        for axis, mean in zip(LINEAR_LETTERS, closure.mean(axis=1), strict=True):
            figures[f"closure_mean_{axis}_um"] = float(mean)
    for u, axis in enumerate(LINEAR_LETTERS):
        beside = (solution[u] ** 2) @ (1 - walk.rays[:, u] ** 2)
        figures[f"mirror_scale_{axis}_um_per_m"] = noise.tilt_urad * float(np.sqrt(beside))
    return {name: value for name, value in figures.items() if value is not None}
