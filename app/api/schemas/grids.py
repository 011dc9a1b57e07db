"""Grids for controllers that interpolate trilinearly, over HTTP."""

from __future__ import annotations

from typing import Annotated

from pydantic import ConfigDict, Field

from app.api.schemas.base import Millimetres, Number
from app.api.schemas.error_field import AnswerHead, VolumeRequest
from app.errors import InvalidContent

Nodes = Annotated[list[Millimetres], Field(min_length=2, max_length=10_000)]
Cells = list[list[list[Number]]]
Corners = list[list[list[list[Number]]]]


class GridRequest(VolumeRequest):
    """The nodes of a grid, or the tolerance that an evenly spaced grid is to keep."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "temperatures_c": {"x-middle": 24.1, "z-column": 27.3},
                "x_mm": [0, 250, 500],
                "y_mm": [0, 250, 500],
                "z_mm": [0, 200, 400],
                "missing_components": "zero",
            }
        }
    )

    x_mm: Nodes | None = Field(None, description="Coordinates of the nodes along x [mm]")
    y_mm: Nodes | None = Field(None, description="Coordinates of the nodes along y [mm]")
    z_mm: Nodes | None = Field(None, description="Coordinates of the nodes along z [mm]")
    tolerance_um: Annotated[Number, Field(gt=0)] | None = Field(
        None,
        description="Instead of nodes: largest length of the difference between trilinear "
        "interpolation and model, for which the coarsest even grid is found [µm]",
        examples=[2.0],
    )

    def nodes(self) -> tuple[list[float], list[float], list[float]] | None:
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
        return self.x_mm, self.y_mm, self.z_mm


class GridAnswer(AnswerHead):
    """The corner values of a grid (8.101–8.104), and how far interpolation is from the model.

    Corner values have the indices of x, y, z in this order, then the direction; cells
    have the index of their lower corner. A cell's corners 1 to 8 of the chapter are
    (0,0,0), (1,0,0), (1,1,0), (0,1,0), and the same at z = 1.
    """

    x_mm: list[Number] = Field(description="Coordinates of the nodes along x [mm]")
    y_mm: list[Number] = Field(description="Coordinates of the nodes along y [mm]")
    z_mm: list[Number] = Field(description="Coordinates of the nodes along z [mm]")
    errors_um: Corners = Field(description="Error x, y, z at each node [µm]")
    compensation_um: Corners = Field(description="Minus the error [µm]")
    largest_difference_um: Cells = Field(
        description="Length that the difference between trilinear interpolation and model exceeds "
        "nowhere in each cell [µm]"
    )
    attained_difference_um: Cells = Field(
        description="The largest such difference that was found in each cell [µm]"
    )
    largest_um: Number = Field(
        description="Length that this difference exceeds nowhere in the grid [µm]"
    )
