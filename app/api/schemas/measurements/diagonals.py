"""Sequential step diagonals and body diagonals over HTTP."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from app.api.schemas.base import Number, Point, Schema
from app.api.schemas.error_field import Volume
from app.api.schemas.error_maps import ComponentSchema
from app.api.schemas.measurements.base import (
    MeasuredPositions,
    MeasurementAnswer,
    MeasurementRequest,
    Runs,
)
from app.errors import InvalidContent
from app.geometry.error_table import Table
from app.rounding import Micro

Triple = Annotated[list[Number], Field(min_length=3, max_length=3)]
Rows = Annotated[list[Triple], Field(min_length=1, max_length=1000)]


class StepDiagonalRequest(MeasurementRequest):
    """Readings of a laser along body diagonals, after each single step of x, y and z."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "origin_mm": [0, 0, 0],
                "step_mm": [100, 100, 80],
                "diagonals": {
                    "ppp": [[0.4, 0.9, 1.1], [1.6, 2.0, 2.3]],
                    "npp": [[0.2, 0.7, 0.9], [1.1, 1.6, 1.8]],
                    "pnp": [[0.5, 0.8, 1.0], [1.4, 1.8, 2.1]],
                    "ppn": [[0.3, 0.8, 0.9], [1.3, 1.7, 1.8]],
                },
            }
        }
    )

    origin_mm: Point = Field(description="Lowest corner x, y, z of the volume [mm]")
    step_mm: Point = Field(description="Length of a step of x, y and z [mm]")
    diagonals: dict[str, Rows] = Field(
        description="Diagonal (ppp, npp, pnp, ppn) to a row for each step: displacement along the "
        "diagonal since its start less its nominal, after x, after y, after z [µm]"
    )
    line: Literal["end-points", "least-squares"] = Field(
        "end-points", description="The line from which straightness counts"
    )
    tool_offset_mm: Point = Field(
        [0.0, 0.0, 0.0], description="Tool offset of the target's middle [mm]"
    )
    target: Literal["point", "flat-mirror"] = Field(
        "point", description="What reflects; it decides what known angular errors do"
    )
    mirror_angle_urad: Annotated[Number, Field(ge=0)] | None = Field(
        None,
        description="Standard uncertainty of each of the mirror's two tilts [µrad]; what the "
        "closures show if left out",
    )
    angular: list[ComponentSchema] = Field(
        default_factory=list,
        max_length=60,
        description="Known angular errors, whose effect is taken out of the readings [µrad]",
    )

    def known_angular(self) -> dict[str, Table]:
        """Give the known angular errors; InvalidContent names the one that is wrong."""
        tables = {}
        for i, row in enumerate(self.angular):
            try:
                table = row.to_table()
            except InvalidContent as error:
                raise error.inside(f"angular.{i}") from None
            tables[table.component.code] = Table(table.positions_mm, table.errors)
        return tables


class StepDiagonalAnswer(MeasurementAnswer):
    """Nine translations and three squareness errors."""

    closure_um: list[list[Micro]] | None = Field(
        description="For x, y, z and each interval: what the four diagonals contradict each "
        "other by, the measurement's own noise [µm]; null with three diagonals"
    )


class DiagonalRunsSchema(Schema):
    """Readings along one body diagonal."""

    positions_mm: MeasuredPositions = Field(
        min_length=2, description="Positions along the diagonal [mm]"
    )
    forward_um: Runs = Field(
        description="Displacement along the diagonal less its nominal, one run or several [µm]"
    )
    backward_um: Runs | None = Field(None, description="The same on the way back [µm]")

    def readings(self) -> dict[str, list[float] | list[list[float]]]:
        """Give the readings by name."""
        readings: dict[str, list[float] | list[list[float]]] = {
            "positions_mm": self.positions_mm,
            "forward_um": self.forward_um,
        }
        return (
            readings if self.backward_um is None else readings | {"backward_um": self.backward_um}
        )


class BodyDiagonalRequest(MeasurementRequest):
    """Readings along the four body diagonals (ISO 230-6)."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "diagonals": {
                    "ppp": {"positions_mm": [0, 812.4], "forward_um": [0, 12.1]},
                    "npp": {"positions_mm": [0, 812.4], "forward_um": [0, 8.4]},
                    "pnp": {"positions_mm": [0, 812.4], "forward_um": [0, 9.9]},
                    "ppn": {"positions_mm": [0, 812.4], "forward_um": [0, 10.2]},
                }
            }
        }
    )

    diagonals: dict[str, DiagonalRunsSchema] = Field(
        description="Readings of each diagonal: ppp, npp, pnp, ppn"
    )
    volume: Volume


class BodyDiagonalAnswer(MeasurementAnswer):
    """Ed, ESd, and the squareness that the diagonals' ends show."""

    Ed_um: Micro = Field(description="Largest range on a diagonal [µm]")
    ESd_um: Micro = Field(description="Range over all diagonals together [µm]")
    diagonals_um: dict[str, Micro] = Field(description="Range on each diagonal [µm]")
    reversal_um: dict[str, Micro] = Field(
        description="Largest reversal value on each diagonal, forward less backward [µm]"
    )
