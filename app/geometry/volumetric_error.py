"""The error at the tool for any configuration (C. Wang, 8.63–8.82, as one rule).

    e(p) = Σ_u [ E(u) + ω(u) × ( a_u(p) + T ) ] + squareness

over the axes u of the chain, where a_u(p) is p with the coordinates that u does
not act on set to 0. Rotation is positive by the right-hand rule; R of (8.62) is
the inverse of the active small rotation.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray
from app.errors import InvalidContent
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, Component
from app.units import MM_PER_M

MeasuringLines = Mapping[str, tuple[float, float, float]]


def volumetric_error(
    chain: Chain,
    errors: Mapping[str, FloatArray],
    points_mm: ArrayLike,
    tool_offset_mm: ArrayLike = (0.0, 0.0, 0.0),
    measuring_lines_mm: MeasuringLines | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Sum all component errors at points of the work volume.

    Parameters
    ----------
    chain
        Order of the axes.
    errors : mapping of component code to ndarray, shape (n,) or ()
        Each component's error at each point's coordinate of its axis
        [the component's unit]; components left out count as zero.
    points_mm : array-like, shape (n, 3) [mm]
        Nominal positions x, y, z.
    tool_offset_mm : array-like, shape (3,) or (n, 3) [mm]
        Tool offset T.
    measuring_lines_mm
        Axis to the point of the line along which its translations were measured
        [mm]: they then contain the rotation times that line's offset already
        (Y.-Y. Hsu 2011, 17–25), so the lever arms count from that line.

    Returns
    -------
    errors_um : ndarray, shape (n, 3) [µm]
        Actual minus nominal position of the tool in the workpiece's coordinates.
    orientation_urad : ndarray, shape (n, 3) [µrad]
        Error of the tool's direction, Σω × k = (ΣEB, −ΣEA, 0) (Hsu, Table I).

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
    points = np.atleast_2d(np.asarray(points_mm, dtype=float))
    if points.shape[1] != 3:
        raise InvalidContent.of_field(
            "points_mm", f"expected points of 3 coordinates in mm, came {points.shape[1]}"
        )
    tool = np.broadcast_to(np.asarray(tool_offset_mm, dtype=float), points.shape)
    total = np.zeros(points.shape)
    rotation = np.zeros(points.shape)
    for axis in chain.axes:
        translation, omega = _motion(axis, errors, points)
        line = (measuring_lines_mm or {}).get(axis)
        total += translation + np.cross(omega, _lever(chain, axis, points, tool, line)) / MM_PER_M
        rotation += omega
    total += _squareness(errors, points)
    tool_direction = np.column_stack([rotation[:, 1], -rotation[:, 0], np.zeros(len(points))])
    return total, tool_direction


def _motion(
    axis: str, errors: Mapping[str, FloatArray], points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Sum one axis' translations [µm] and rotations [µrad] with their slopes: (n, 3) each."""
    translation = np.zeros(points.shape)
    omega = np.zeros(points.shape)
    for code, values in errors.items():
        component = COMPONENTS[code]
        if component.axis == axis:
            into = omega if component.is_rotation else translation
            into[:, _index(component)] += values * _multiplier(component, points)
    return translation, omega


def _squareness(errors: Mapping[str, FloatArray], points: FloatArray) -> FloatArray:
    total = np.zeros(points.shape)
    for code, values in errors.items():
        component = COMPONENTS[code]
        if component.axis is None and component.times is not None:
            total[:, _index(component)] += values * _multiplier(component, points)
    return total


def _lever(
    chain: Chain,
    axis: str,
    points: FloatArray,
    tool: FloatArray,
    line: tuple[float, float, float] | None,
) -> FloatArray:
    """a_u(p) + T, counted from the measuring line where one is stated: (n, 3) [mm]."""
    mask = np.array([letter in chain.acts_on(axis) for letter in LINEAR_LETTERS], dtype=float)
    arm: FloatArray = points * mask + tool
    if line is None:
        return arm
    on_line = np.broadcast_to(np.asarray(line, dtype=float), points.shape).copy()
    along = LINEAR_LETTERS.index(axis)
    on_line[:, along] = points[:, along]
    from_line: FloatArray = arm - on_line * mask
    return from_line


def _index(component: Component) -> int:
    """Which of the three numbers a component belongs to."""
    return "xyzabc".index(component.direction) % 3


def _multiplier(component: Component, points: FloatArray) -> FloatArray | float:
    """The coordinate that a slope or squareness multiplies [m], else 1."""
    if component.times is None:
        return 1.0
    return points[:, LINEAR_LETTERS.index(component.times)] / MM_PER_M
