"""Corner values for a controller that interpolates trilinearly, and how far it is off."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from app.arrays import FloatArray
from app.errors import InvalidContent
from app.geometry.components import LINEAR_LETTERS
from app.geometry.grid import ErrorGrid, checked_nodes, sample_grid
from app.geometry.grid_difference import GridDifference, grid_difference
from app.geometry.grid_spacing import spacing_for_tolerance
from app.services.ask_field import (
    FieldAnswer,
    FieldQuestion,
    ask_field,
    check_travel,
    work_volume,
)
from app.services.context import Context
from app.thermal.machine import Machine, Travel

MOST_NODES = 250_000
"""Of one grid; controllers know some ten thousand."""

Nodes = tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """A grid, and the largest difference between its interpolation and the model by cell.

    `bound_um` is a length of that difference that is exceeded nowhere in the grid [µm].
    """

    answer: FieldAnswer
    grid: ErrorGrid
    difference: GridDifference
    bound_um: float
    warnings: list[str]


def compute_grid(
    context: Context, machine_id: str, question: FieldQuestion, nodes_mm: Nodes
) -> Grid:
    """Give the volumetric error at the nodes of a grid.

    Parameters
    ----------
    nodes_mm
        Coordinates of the nodes along x, y and z [mm], at least two each.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field`; InvalidContent also for coordinates that are no grid, outside
        the axes' travel, or too many.
    """
    for axis, nodes in zip(LINEAR_LETTERS, nodes_mm, strict=True):
        checked_nodes(f"{axis}_mm", nodes)
    _check_size(math.prod(nodes.size for nodes in nodes_mm))
    answer = ask_field(context, machine_id, question, orientation=False)
    _expect_three_axes(answer.machine)
    for axis, nodes in zip(LINEAR_LETTERS, nodes_mm, strict=True):
        check_travel(answer.machine, axis, (float(nodes[0]), float(nodes[-1])), f"{axis}_mm")
    return _sampled(answer, question, nodes_mm, [])


def grid_for_tolerance(
    context: Context,
    machine_id: str,
    question: FieldQuestion,
    tolerance_um: float,
    volume: Mapping[str, Travel] | None = None,
) -> Grid:
    """Give the coarsest evenly spaced grid whose interpolation stays within a tolerance.

    Parameters
    ----------
    tolerance_um
        Largest length of the difference between interpolation and model [µm].
    volume
        Range of each axis; its travel where nothing is stated.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `compute_grid`; InvalidContent also if no grid keeps the tolerance.
    """
    answer = ask_field(context, machine_id, question, orientation=False)
    _expect_three_axes(answer.machine)
    box, remarks = work_volume(answer, volume)
    spacing = spacing_for_tolerance(answer.field, box, tolerance_um, question.tool_offset_mm)
    _check_size(spacing.points)
    x, y, z = (
        np.linspace(*range_mm, intervals + 1)
        for range_mm, intervals in zip(box.ranges_mm, spacing.intervals, strict=True)
    )
    return _sampled(answer, question, (x, y, z), remarks, spacing.bound_um)


def _sampled(
    answer: FieldAnswer,
    question: FieldQuestion,
    nodes_mm: Nodes,
    remarks: list[str],
    bound_um: float = math.inf,
) -> Grid:
    tool = question.tool_offset_mm
    grid = sample_grid(answer.field, *nodes_mm, tool)
    difference = grid_difference(answer.field, grid, tool)
    bound_um = min(bound_um, difference.largest_um)
    return Grid(answer, grid, difference, bound_um, [*answer.warnings, *remarks])


def _expect_three_axes(machine: Machine) -> None:
    lacking = [axis for axis in LINEAR_LETTERS if axis not in machine.chain.axes]
    if lacking:
        raise InvalidContent.of_field(
            f"{lacking[0]}_mm",
            f"expected a machine with x, y and z for a grid in three dimensions, got "
            f"{machine.chain.text} without {', '.join(lacking)}",
        )


def _check_size(nodes: int) -> None:
    if nodes > MOST_NODES:
        raise InvalidContent.of_field(
            "x_mm", f"expected a grid of at most {MOST_NODES} nodes, got {nodes}"
        )
