"""The volumetric error at points, at stated temperatures or at the latest reading."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.arrays import FloatArray
from app.errors import InvalidContent, counted
from app.geometry.components import LINEAR_LETTERS
from app.services.ask_field import FieldAnswer, FieldQuestion, ask_field
from app.services.context import Context
from app.thermal.machine import Machine

MOST_NUMBERS = 1_000_000
"""Points times thermal states in one call."""


@dataclass(frozen=True, slots=True, eq=False)
class VolumetricError:
    """Errors at points [µm, µrad], shape (n, 3), or (s, n, 3) for several thermal states.

    `outside_travel` are the indices of points that the axes cannot reach.
    """

    asked: FieldAnswer
    errors_um: FloatArray
    orientation_urad: FloatArray
    outside_travel: NDArray[np.intp]
    warnings: list[str]


def compute_volumetric_error(
    context: Context,
    machine_id: str,
    question: FieldQuestion,
    points_mm: FloatArray,
    *,
    outside_travel_allowed: bool = False,
) -> VolumetricError:
    """Sum all components at points.

    Parameters
    ----------
    context, machine_id, question
        As `ask_field`.
    points_mm : ndarray, shape (n, 3) [mm]
        Nominal points.
    outside_travel_allowed
        Whether points outside the axes' travel are answered, and flagged.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field`; InvalidContent also for points outside the travel, or too many.
    """
    states = len(question.temperatures_c or [0])
    if states * len(points_mm) > MOST_NUMBERS:
        raise InvalidContent.of_field(
            "points_mm",
            f"expected at most {MOST_NUMBERS} points times thermal states in one call, came "
            f"{len(points_mm)} times {states}",
        )
    asked = ask_field(context, machine_id, question)
    outside = _outside_travel(asked.machine, points_mm)
    if outside.size and not outside_travel_allowed:
        raise _refused(asked.machine, points_mm, outside)
    errors_um, orientation_urad = asked.field.at(points_mm, question.tool_offset_mm)
    warnings = [*asked.warnings, *_beyond_tables(asked, points_mm)]
    if outside.size:
        warnings.append(f"{counted(outside.size, 'point')} outside the axes' travel")
    return VolumetricError(asked, errors_um, orientation_urad, outside, warnings)


def _outside_travel(machine: Machine, points_mm: FloatArray) -> NDArray[np.intp]:
    """Find points that the axes cannot reach; an axis that is not there stands at 0."""
    outside = np.zeros(len(points_mm), dtype=bool)
    for i, axis in enumerate(LINEAR_LETTERS):
        travel = machine.axes.get(axis)
        if travel is not None:
            along = points_mm[:, i]
            outside |= (along < travel.min_mm) | (along > travel.max_mm)
        elif axis not in machine.chain.axes:
            outside |= points_mm[:, i] != 0.0
    return np.flatnonzero(outside)


def _refused(machine: Machine, points_mm: FloatArray, outside: NDArray[np.intp]) -> InvalidContent:
    first = int(outside[0])
    reach = [f"{axis} {t.min_mm:g} to {t.max_mm:g} mm" for axis, t in sorted(machine.axes.items())]
    reach += [f"no {axis}" for axis in LINEAR_LETTERS if axis not in machine.chain.axes]
    others = f" and {outside.size - 1} more" if outside.size > 1 else ""
    return InvalidContent.of_field(
        f"points_mm.{first}",
        f"expected points within the axes' travel ({', '.join(reach)}), came "
        f'{points_mm[first].tolist()} mm{others}; state "outside_travel": "allow" to have them '
        "answered",
    )


def _beyond_tables(asked: FieldAnswer, points_mm: FloatArray) -> list[str]:
    """Say of each axis how many points lie beyond its tables, where their end values hold."""
    said = []
    for i, axis in enumerate(LINEAR_LETTERS):
        nodes = asked.field.nodes_mm(axis)
        if nodes.size:
            along = points_mm[:, i]
            beyond = int(np.count_nonzero((along < nodes[0]) | (along > nodes[-1])))
            if beyond:
                said.append(
                    f"{counted(beyond, 'point')} beyond the tables of {axis}, {nodes[0]:g} to "
                    f"{nodes[-1]:g} mm: their end values hold there"
                )
    return said
