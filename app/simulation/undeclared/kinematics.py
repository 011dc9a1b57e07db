"""The error at the tool, by walking the chain from the tool's tip to the workpiece.

The position seen so far and its error are carried from joint to joint as homogeneous
transformations of the first order carry them: a rotation ω turns what lies before it, so it
adds ω × position; a translation adds its own error and moves the position on. On the tool's
side an axis turns and then moves, on the workpiece's side it moves and then turns, because a
workpiece-side error is stated as what the tool seems to do in the workpiece's coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from app.simulation.undeclared.components import AXES, COMPONENTS, MM_PER_M, FloatArray


def volumetric_error(
    chain: str,
    errors: Mapping[str, FloatArray],
    points_mm: FloatArray,
    tools_mm: FloatArray,
) -> FloatArray:
    """Carry all errors to the tool's tip.

    Parameters
    ----------
    chain
        Axes around the base F, such as `XYFZ`: before it those that move the workpiece, after
        it those that move the tool, each from the base outward.
    errors : mapping of component code to ndarray, shape (n,)
        Each component's error at each point [µm, µrad, µm/m]; others are zero.
    points_mm, tools_mm : ndarray, shape (n, 3) [mm]
        Nominal positions and tool offsets.

    Returns
    -------
    ndarray, shape (n, 3) [µm]
        Actual minus nominal, in the workpiece's coordinates.

    Examples
    --------
    >>> yaw = {"EBX": np.array([10.0])}
    >>> point, tool = np.array([[0.0, 0.0, 200.0]]), np.array([[0.0, 0.0, 100.0]])
    >>> volumetric_error("XYFZ", yaw, point, tool).round(9).tolist()
    [[3.0, 0.0, 0.0]]
    """
    workpiece, _, tool = chain.lower().partition("f")
    walk = [(axis, True) for axis in reversed(tool)] + [(axis, False) for axis in workpiece]
    position = tools_mm / MM_PER_M
    error = np.zeros(position.shape)
    for axis, is_tool_side in walk:
        i = AXES.index(axis)
        moved = position.copy()
        moved[:, i] += points_mm[:, i] / MM_PER_M
        motion = _motion(errors, i, len(error))
        error += motion[:, :3] + np.cross(motion[:, 3:], position if is_tool_side else moved)
        position = moved
    return error + _squareness(errors, points_mm / MM_PER_M)


def _motion(errors: Mapping[str, FloatArray], axis: int, n: int) -> FloatArray:
    """Set an axis' six errors side by side: shape (n, 6)."""
    motion = np.zeros((n, 6))
    for code, values in errors.items():
        if COMPONENTS[code].axis == axis:
            motion[:, COMPONENTS[code].row] = values
    return motion


def _squareness(errors: Mapping[str, FloatArray], points_m: FloatArray) -> FloatArray:
    """E_x gains SXY·y + SZX·z, E_y gains SYZ·z."""
    error = np.zeros(points_m.shape)
    for code, values in errors.items():
        component = COMPONENTS[code]
        if component.times is not None:
            error[:, component.row] += values * points_m[:, component.times]
    return error
