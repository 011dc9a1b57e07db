"""Which components the volumetric error of a machine consists of."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray
from app.geometry.chain import Chain
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, ROTATION_LETTERS, Component, Kind
from app.geometry.measuring_line import MeasuringLine, MeasuringLines
from app.geometry.volumetric_error import NO_TOOL

_RIGID = frozenset({Kind.LINEAR, Kind.STRAIGHTNESS, Kind.ANGULAR, Kind.SQUARENESS})


def needed_components(
    chain: Chain,
    tool_offset_mm: ArrayLike = NO_TOOL,
    measuring_lines: MeasuringLines | None = None,
    *,
    orientation: bool = True,
) -> list[str]:
    """List the components without which the volumetric error is not known.

    Parameters
    ----------
    tool_offset_mm : array-like, shape (3,) or (n, 3) [mm]
    measuring_lines
        Axis to the line along which its translations were measured: lever arms, the
        tool's too, count from there.
    orientation
        Whether the tool's direction is asked for beside its position.

    Returns
    -------
    list of str
        Codes of the rigid body's components: translations, squareness between the
        chain's axes, and those rotations that have a lever arm or turn the tool.

    Examples
    --------
    >>> len(needed_components(Chain.parse("XFYZ"), (10.0, 20.0, 160.0)))
    21
    >>> needed_components(Chain.parse("FZX"))
    ['EXX', 'EYX', 'EZX', 'EAX', 'EBX', 'EXZ', 'EYZ', 'EZZ', 'EAZ', 'EBZ', 'ECZ', 'SZX']
    """
    offsets = np.atleast_2d(np.asarray(tool_offset_mm, dtype=np.float64))
    lines = measuring_lines or {}
    return [
        code
        for code, component in COMPONENTS.items()
        if component.kind in _RIGID
        and _matters(component, chain, offsets, lines.get(str(component.axis)), orientation)
    ]


def _matters(
    component: Component,
    chain: Chain,
    tools_mm: FloatArray,
    line: MeasuringLine | None,
    orientation: bool,
) -> bool:
    if component.axis is None:
        return {component.direction, component.times} <= set(chain.axes)
    if component.axis not in chain.axes:
        return False
    if not component.is_rotation:
        return True
    about = LINEAR_LETTERS[ROTATION_LETTERS.index(component.direction)]
    # The tool points along z: a rotation about z does not change its direction.
    turns_tool = orientation and about != "z"
    # ω × a has nothing of the part of a that lies along ω: a roll does not move what is on its own
    # axis.
    return turns_tool or bool(_arms(chain, component.axis, tools_mm, line) - {about})


def _arms(chain: Chain, axis: str, tools_mm: FloatArray, line: MeasuringLine | None) -> set[str]:
    """Directions in which an axis' rotations have a lever: a_u(p) + T, or what a line leaves."""
    moving = set(chain.acts_on(axis)) - ({axis} if line else set())
    reach_mm = tools_mm - (line.tool_offset_mm if line else np.zeros(3))
    return moving | {u for u, t in zip(LINEAR_LETTERS, reach_mm.T, strict=True) if t.any()}
