"""Corner values for a controller that interpolates trilinearly, and how far it is off."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from app.arrays import FloatArray
from app.errors import InvalidContent
from app.geometry.components import LINEAR_LETTERS
from app.geometry.grid import checked_nodes, sample_grid
from app.geometry.grid_difference import grid_difference
from app.geometry.grid_spacing import spacing_for_tolerance
from app.rounding import listed, rounded, rounded_up
from app.services.ask_field import (
    AnswerHead,
    FieldAnswer,
    VolumeQuestion,
    ask_field,
    check_travel,
    work_volume,
)
from app.services.context import Context
from app.stated import Millimetres, Number
from app.thermal.machine import Machine

MOST_NODES = 250_000
"""Of one grid; controllers know some ten thousand."""

Nodes = tuple[FloatArray, FloatArray, FloatArray]
StatedNodes = Annotated[list[Millimetres], Field(min_length=2, max_length=10_000)]


class GridRequest(
    VolumeQuestion,
    example={
        "temperatures_c": {"x-middle": 24.1, "z-column": 27.3},
        "x_mm": [0, 250, 500],
        "y_mm": [0, 250, 500],
        "z_mm": [0, 200, 400],
        "missing_components": "zero",
    },
):
    """The nodes of a grid, or the tolerance that an evenly spaced grid is to keep."""

    x_mm: StatedNodes | None = Field(None, description="Coordinates of the nodes along x [mm]")
    y_mm: StatedNodes | None = Field(None, description="Coordinates of the nodes along y [mm]")
    z_mm: StatedNodes | None = Field(None, description="Coordinates of the nodes along z [mm]")
    tolerance_um: Annotated[Number, Field(gt=0)] | None = Field(
        None,
        description="Instead of nodes: largest length of the difference between trilinear "
        "interpolation and model, for which the coarsest even grid is found [µm]",
        examples=[2.0],
    )

    def nodes(self) -> Nodes | None:
        """Give the nodes, or None where a tolerance is stated; InvalidContent unless one is."""
        nodes_by_axis = {"x_mm": self.x_mm, "y_mm": self.y_mm, "z_mm": self.z_mm}
        if self.tolerance_um is not None:
            both = [name for name, nodes in nodes_by_axis.items() if nodes is not None]
            if both:
                raise InvalidContent.of_field(
                    both[0], "expected the nodes in mm or a tolerance_um in µm, got both"
                )
            return None
        if self.x_mm is None or self.y_mm is None or self.z_mm is None:
            lacking = [name for name, nodes in nodes_by_axis.items() if nodes is None]
            raise InvalidContent.of_field(
                lacking[0],
                f"expected coordinates in mm ({', '.join(lacking)}), or a tolerance_um in µm, "
                "got neither",
            )
        if self.volume:
            raise InvalidContent.of_field(
                "volume", "expected a volume with a tolerance_um only: the nodes say the volume"
            )
        return np.array(self.x_mm), np.array(self.y_mm), np.array(self.z_mm)


@dataclass(frozen=True, eq=False, kw_only=True)
class Grid(AnswerHead, published_as="GridAnswer"):
    """The corner values of a grid (8.101–8.104), and how far interpolation is from the model.

    Corner values have the indices of x, y, z in this order, then the direction; cells
    have the index of their lower corner. A cell's corners 1 to 8 of the chapter are
    (0,0,0), (1,0,0), (1,1,0), (0,1,0), and the same at z = 1.
    """

    x_mm: Annotated[FloatArray, listed(1)]
    """Coordinates of the nodes along x [mm]"""
    y_mm: Annotated[FloatArray, listed(1)]
    """Coordinates of the nodes along y [mm]"""
    z_mm: Annotated[FloatArray, listed(1)]
    """Coordinates of the nodes along z [mm]"""
    errors_um: Annotated[FloatArray, listed(4)]
    """Error x, y, z at each node [µm]"""
    compensation_um: Annotated[FloatArray, listed(4)]
    """Minus the error [µm]"""
    largest_difference_um: Annotated[FloatArray, listed(3)]
    """Length that the difference between trilinear interpolation and model exceeds nowhere in each
    cell [µm]"""
    attained_difference_um: Annotated[FloatArray, listed(3)]
    """The largest such difference that was found in each cell [µm]"""
    largest_um: float
    """Length that this difference exceeds nowhere in the grid [µm]"""


def compute_grid(context: Context, machine_id: str, request: GridRequest) -> Grid:
    """Give the volumetric error at stated nodes, or of the coarsest even grid for a tolerance.

    Raises
    ------
    UnknownThing, NoReading, InvalidContent
        As `ask_field`; InvalidContent also for coordinates that are no grid, outside
        the axes' travel, or too many, and if no grid keeps the tolerance.
    """
    nodes_mm = request.nodes()
    if nodes_mm is None:
        return _grid_for_tolerance(context, machine_id, request)
    for axis, nodes in zip(LINEAR_LETTERS, nodes_mm, strict=True):
        checked_nodes(f"{axis}_mm", nodes)
    _check_size(math.prod(nodes.size for nodes in nodes_mm))
    answer = ask_field(context, machine_id, request, orientation=False)
    _expect_three_axes(answer.machine)
    for axis, nodes in zip(LINEAR_LETTERS, nodes_mm, strict=True):
        check_travel(answer.machine, axis, (float(nodes[0]), float(nodes[-1])), f"{axis}_mm")
    return _sampled(answer, request, nodes_mm, [])


def _grid_for_tolerance(context: Context, machine_id: str, request: GridRequest) -> Grid:
    answer = ask_field(context, machine_id, request, orientation=False)
    _expect_three_axes(answer.machine)
    box, remarks = work_volume(answer, request.volume)
    spacing = spacing_for_tolerance(
        answer.field, box, request.tolerance_um or 0.0, request.tool_offset_mm
    )
    _check_size(spacing.points)
    x, y, z = (
        np.linspace(*range_mm, intervals + 1)
        for range_mm, intervals in zip(box.ranges_mm, spacing.intervals, strict=True)
    )
    return _sampled(answer, request, (x, y, z), remarks, spacing.bound_um)


def _sampled(
    answer: FieldAnswer,
    request: GridRequest,
    nodes_mm: Nodes,
    remarks: list[str],
    bound_um: float = math.inf,
) -> Grid:
    tool = request.tool_offset_mm
    grid = sample_grid(answer.field, *nodes_mm, tool)
    difference = grid_difference(answer.field, grid, tool)
    largest_um = np.array(min(bound_um, difference.largest_um))
    return Grid(
        **answer.head(remarks),
        x_mm=grid.x_mm,
        y_mm=grid.y_mm,
        z_mm=grid.z_mm,
        errors_um=rounded(grid.errors_um),
        compensation_um=rounded(0.0 - grid.errors_um),
        largest_difference_um=rounded_up(difference.bound_length_um),
        attained_difference_um=rounded(difference.attained_length_um),
        largest_um=rounded_up(largest_um).item(),
    )


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
