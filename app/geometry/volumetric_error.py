"""The error at the tool for any configuration (C. Wang, 8.63–8.82, as one rule).

    e(p) = Σ_u [ E(u) + ω(u) × ( a_u(p) + T ) ] + squareness

over the axes u of the chain, where a_u(p) is p with the coordinates that u does
not act on set to 0. Rotation is positive by the right-hand rule; R of (8.62) is
the inverse of the active small rotation.

`sum_over_axes` is the rule; `volumetric_error` asks it for errors that are known at
each point, `ErrorField` for errors that it reads from tables.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray
from app.errors import InvalidContent, counted
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, LINEAR_LETTERS
from app.geometry.measuring_line import MeasuringLine, MeasuringLines
from app.units import MM_PER_M

Values: TypeAlias = FloatArray | float
Motion: TypeAlias = dict[str | None, FloatArray]
"""One axis' errors at n points, by what they multiply: None for the errors themselves, a
coordinate for their nonrigid slopes. Rows x, y, z [µm; µm/m], a, b, c [µrad; µrad/m]."""

Squareness: TypeAlias = list[tuple[int, int, Values]]
"""Row of the error, coordinate that is multiplied, and the value [µm/m]."""

Arm: TypeAlias = list[Values | None]
"""Three lengths [m]; None where there is no lever."""

NO_TOOL: Final = (0.0, 0.0, 0.0)
ROWS: Final = range(3)
"""Of x, y and z."""


def volumetric_error(
    chain: Chain,
    errors: Mapping[str, FloatArray],
    points_mm: ArrayLike,
    tool_offset_mm: ArrayLike = NO_TOOL,
    measuring_lines: MeasuringLines | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Sum all component errors at points of the work volume.

    Parameters
    ----------
    errors : mapping of component code to ndarray, shape (n,) or ()
        Each component's error at each point's coordinate of its axis
        [the component's unit]; components left out count as zero.
    points_mm : array-like, shape (n, 3) [mm]
        Nominal positions x, y, z.
    tool_offset_mm : array-like, shape (3,) or (n, 3) [mm]
    measuring_lines
        Axis to the line along which its translations were measured: they then contain
        the rotation times that line's offset already (Y.-Y. Hsu 2011, 17–25), so lever
        arms and nonrigid slopes count from that line.

    Returns
    -------
    errors_um : ndarray, shape (n, 3) [µm]
        Actual minus nominal position of the tool in the workpiece's coordinates.
    orientation_urad : ndarray, shape (n, 3) [µrad]
        Error of the tool's direction, Σω × k = (ΣEB, −ΣEA, 0) (Hsu, Table I).

    Raises
    ------
    InvalidContent
        If points or tool offsets do not have three coordinates.

    Notes
    -----
    First order in the errors. Nonrigid slopes (8.1–8.18) add slope × coordinate to
    their parent; squareness (8.58–8.60) adds SXY·y + SZX·z to E_x and SYZ·z to E_y.

    Examples
    --------
    >>> import numpy as np
    >>> e, _ = volumetric_error(Chain.parse("FXYZ"), {"EBX": np.array([10.0])}, [[0, 0, 200.0]])
    >>> e.tolist()
    [[2.0, 0.0, 0.0]]
    """
    points = as_points(points_mm)
    tool = as_tool_offset(tool_offset_mm, len(points))
    motions = _motions(chain, errors, len(points))
    total, turned = sum_over_axes(
        chain, motions, squareness_of(errors), points.T, tool.T, measuring_lines or {}
    )
    return np.ascontiguousarray(total.T), tool_direction(turned).T.copy()


def sum_over_axes(
    chain: Chain,
    motions: Mapping[str, Motion],
    squareness: Squareness,
    points_mm: FloatArray,
    tool_offset_mm: FloatArray,
    measuring_lines: MeasuringLines,
) -> tuple[FloatArray, FloatArray]:
    """Sum translations and rotations with their lever arms: the rule itself.

    Parameters
    ----------
    points_mm : ndarray, shape (3, n) [mm]
        One row for each coordinate.
    tool_offset_mm : ndarray, shape (3,) or (3, n) [mm]

    Returns
    -------
    errors_um : ndarray, shape (3, n) [µm]
        The sum of 8.68–8.82 for this chain.
    rotation_urad : ndarray, shape (3, n) [µrad]
        Σω = (ΣEA, ΣEB, ΣEC) (8.115–8.117).
    """
    # The chapter writes each chain as a product of the axes' small rotations RI(u) = 1 + ω(u) ×,
    # such as
    #     FXYZ  P = X + RI(x) Y + RI(x) RI(y) Z + RI(x) RI(y) RI(z) T                   (8.63)
    #     XYFZ  P = RI(y) RI(x) X + RI(y) Y + RI(y) RI(x) Z + RI(x) RI(y) RI(z) T       (8.65)
    # Without products of two rotations, ω(u) turns the sum of all vectors that RI(u) stands before:
    # in FXYZ that is Y + Z + T for x, Z + T for y and T for z, which gives (8.68)–(8.73); in XYFZ
    # it is X + Z + T for x and X + Y + Z + T for y, (8.77)–(8.79). `Chain.acts_on` names these
    # vectors. That the order of the rotations before T differs in (8.65) and (8.66) is of second
    # order.
    points_m = points_mm / MM_PER_M
    total = np.zeros(points_m.shape)
    turned = np.zeros(points_m.shape)
    for axis in chain.axes:
        if axis in motions:
            line = measuring_lines.get(axis)
            along, grown = _along_and_beside(motions[axis], points_m, line)
            arm = [points_m[i] if LINEAR_LETTERS[i] in chain.acts_on(axis) else None for i in ROWS]
            # On a measuring line the translations have the rotation's effect there already, so the
            # rotation that was measured counts from the line. What slopes add away from the line
            # was not there when the translations were measured: they have nothing of it, and it
            # acts with the whole arm.
            for motion, lever in ((along, _from_line(arm, axis, line)), (grown, arm)):
                if motion is not None:
                    total += motion[:3]
                    turned += motion[3:]
                    _add_cross(total, motion[3:], lever)
    # T is an arm of every axis: Σ ω × T = (Σ ω) × T.
    _add_cross(total, turned, [t / MM_PER_M if np.any(t) else None for t in tool_offset_mm])
    # (8.58)–(8.60) put squareness into the straightness of y and z: it displaces, and turns
    # nothing.
    for row, times, value in squareness:
        total[row] += value * points_m[times]
    return total, turned


def tool_direction(rotation_urad: FloatArray) -> FloatArray:
    """Turn the tool's nominal direction k by a small rotation: ω × k = (EB, −EA, 0).

    Parameters
    ----------
    rotation_urad : ndarray, shape (3, n) [µrad]
        Sum of all rotations.

    Returns
    -------
    ndarray, shape (3, n) [µrad]
        Y.-Y. Hsu 2011, Table I, columns I, J, K.
    """
    about_x, about_y, _ = rotation_urad
    # 0 − 0 is 0, but −0 would be a strange zero to show.
    return np.stack([about_y, 0.0 - about_x, np.zeros_like(about_x)])


def as_points(points_mm: ArrayLike) -> FloatArray:
    """Take points of three coordinates, or one such point, as an array.

    Parameters
    ----------
    points_mm : array-like, shape (n, 3) or (3,) [mm]
        Positions x, y, z.

    Returns
    -------
    ndarray, shape (n, 3) [mm]

    Raises
    ------
    InvalidContent
        If the points do not have three coordinates.
    """
    points = np.atleast_2d(np.asarray(points_mm, dtype=np.float64))
    if points.ndim != 2 or points.shape[1] != 3:
        raise InvalidContent.of_field(
            "points_mm", f"expected points of 3 coordinates in mm, got {points.shape[-1]}"
        )
    return points


def as_tool_offset(tool_offset_mm: ArrayLike, points: int) -> FloatArray:
    """Take one tool offset, or one for each point, as an array.

    Parameters
    ----------
    tool_offset_mm : array-like, shape (3,) or (n, 3) [mm]

    Returns
    -------
    ndarray, same shape [mm]
    """
    tool = np.asarray(tool_offset_mm, dtype=np.float64)
    if tool.shape not in {(3,), (points, 3)}:
        raise InvalidContent.of_field(
            "tool_offset_mm",
            "expected one tool offset x, y, z in mm or one for each of "
            f"{counted(points, 'point')}, got an array of shape {tool.shape}",
        )
    return tool


def _motions(chain: Chain, errors: Mapping[str, Values], n: int) -> dict[str, Motion]:
    """Sort components that are known at n points by axis, by what they multiply, by row."""
    motions: dict[str, Motion] = {}
    for code, values in errors.items():
        component = COMPONENTS[code]
        if component.axis in chain.axes:
            motion = motions.setdefault(str(component.axis), {})
            if component.times not in motion:
                motion[component.times] = np.zeros((6, n))
            motion[component.times][component.row] = values
    return motions


def squareness_of(errors: Mapping[str, Values]) -> Squareness:
    """Pick the squareness errors, which need a coordinate but no axis' table.

    Returns
    -------
    list of (row, coordinate, value)
        SXY adds its value [µm/m] times y, coordinate 1, to E_x, row 0 (8.58–8.60).
    """
    return [
        (component.row, LINEAR_LETTERS.index(component.times), values)
        for component, values in ((COMPONENTS[code], v) for code, v in errors.items())
        if component.axis is None and component.times is not None
    ]


def _along_and_beside(
    motion: Motion, points_m: FloatArray, line: MeasuringLine | None
) -> tuple[FloatArray | None, FloatArray | None]:
    """Split E(u) + Σ slope · coordinate (8.1–8.18): on the measuring line, and beside it.

    Without a line all of it acts with the whole lever arm: it is all known on the axis.
    """
    along = motion.get(None)
    grown = None
    for times, slopes in motion.items():
        if times is not None:
            i = LINEAR_LETTERS.index(times)
            from_mm = 0.0 if line is None else line.point_mm[i]
            added = slopes * (points_m[i] - from_mm / MM_PER_M)
            grown = added if grown is None else grown + added
    # Added before they meet the lever arm, which is the same for both: each cross product goes over
    # all points.
    if line is None and along is not None and grown is not None:
        return along + grown, None
    return along, grown


def _from_line(arm: Arm, axis: str, line: MeasuringLine | None) -> Arm:
    """Count a lever arm from where the axis' translations were measured [m].

    Along its own axis the line is wherever the axis stands: no arm is left there.
    """
    if line is None:
        return arm
    shifted: Arm = []
    for i, lever in enumerate(arm):
        # T is an arm of every axis and is added for all of them at once (`sum_over_axes`): here
        # T_line is taken off, also along coordinates on which the axis does not act.
        distance: Values = -line.tool_offset_mm[i] / MM_PER_M
        if lever is not None and LINEAR_LETTERS[i] != axis:
            distance = lever - line.point_mm[i] / MM_PER_M + distance
        shifted.append(distance if np.any(distance) else None)
    return shifted


def _add_cross(total: FloatArray, omega: FloatArray, arm: Arm) -> None:
    """Add ω × arm, a rotation's effect at the end of its lever [µrad·m = µm]."""
    for i, lever in enumerate(arm):
        if lever is not None:
            # e_j × e_i = −e_k and e_k × e_i = e_j for i, j, k in cyclic order.
            j, k = (i + 1) % 3, (i + 2) % 3
            total[k] -= omega[j] * lever
            total[j] += omega[k] * lever
