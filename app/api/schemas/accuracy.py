"""Volumetric accuracy and compensation levels over HTTP."""

from __future__ import annotations

import math
from typing import Annotated, Any, Self

import numpy as np
from pydantic import ConfigDict, Field

from app.api.schemas.base import Integer, Number, Schema
from app.api.schemas.error_field import AnswerHead, VolumeRequest
from app.api.schemas.machines import TravelSchema
from app.geometry.compensation_levels import CompensationLevel
from app.geometry.components import COMPONENTS
from app.geometry.error_table import Table
from app.geometry.volumetric_accuracy import Spread, VolumetricAccuracy
from app.geometry.work_volume import WorkVolume
from app.rounding import Digits, Micro

Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Deviation = Annotated[Number, Field(ge=0)]
Lines = Annotated[list[Deviation], Field(min_length=1, max_length=1000)]


class AccuracyRequest(VolumeRequest):
    """At which temperatures, with which tool, in which volume."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "temperatures_c": {"x-middle": 24.1, "z-column": 27.3},
                "missing_components": "zero",
            }
        }
    )


class SpreadAnswer(Schema):
    """How far three sums of errors spread over the volume."""

    ranges_um: Annotated[list[Micro], Field(min_length=3, max_length=3)] = Field(
        description="Largest less smallest value in x, y, z (8.122–8.127) [µm]"
    )
    definition_1_um: Micro = Field(
        description="Largest root of the sum of squares of x, y, z (8.118–8.121) [µm]"
    )
    definition_2_um: Micro = Field(
        description="Root of the sum of squares of the ranges (8.128) [µm]"
    )
    worst_point_mm: Vector = Field(description="Where definition 1 has its largest [mm]")
    within_um: Digits = Field(
        description="What the true ranges and definitions may be beyond these: they are "
        "extremes of the model over the whole volume, not of samples [µm]"
    )

    @classmethod
    def of(cls, spread: Spread) -> Self:
        """Show a spread of lengths."""
        return cls(
            ranges_um=list(spread.ranges),
            definition_1_um=spread.definition_1,
            definition_2_um=spread.definition_2,
            worst_point_mm=list(spread.worst_point_mm),
            within_um=spread.within,
        )


class AngularSpreadAnswer(Schema):
    """The same of angles."""

    ranges_urad: Annotated[list[Micro], Field(min_length=3, max_length=3)] = Field(
        description="Largest less smallest value about x, y, z (8.122–8.127) [µrad]"
    )
    definition_1_urad: Micro = Field(
        description="Largest root of the sum of squares (8.119, 8.121) [µrad]"
    )
    definition_2_urad: Micro = Field(
        description="Root of the sum of squares of the ranges (8.129) [µrad]"
    )
    worst_point_mm: Vector = Field(description="Where definition 1 has its largest [mm]")

    @classmethod
    def of(cls, spread: Spread) -> Self:
        """Show a spread of angles."""
        return cls(
            ranges_urad=list(spread.ranges),
            definition_1_urad=spread.definition_1,
            definition_2_urad=spread.definition_2,
            worst_point_mm=list(spread.worst_point_mm),
        )


class AccuracyAnswer(AnswerHead):
    """Every definition of volumetric accuracy (C. Wang, 8.112–8.133, Table 8.2)."""

    volume: dict[str, TravelSchema] = Field(description="The work volume [mm]")
    linear: SpreadAnswer = Field(
        description="Of the sums 8.112–8.114: translations with squareness, no lever arms [µm]"
    )
    angular: AngularSpreadAnswer = Field(description="Of the sums 8.115–8.117 [µrad]")
    with_arms: SpreadAnswer = Field(
        description="Of the volumetric error at the tool, lever arms included [µm]"
    )
    diagonals_um: dict[str, Micro] = Field(
        description="True range of the displacement along each body diagonal [µm]",
        examples=[{"ppp": 12.1, "npp": 9.8, "pnp": 11.0, "ppn": 8.7}],
    )
    Ed_um: Micro = Field(description="ISO 230-6 Ed: largest of the diagonals' ranges [µm]")
    ESd_um: Micro = Field(description="ESd: range over all diagonals together [µm]")
    ELv_um: Micro = Field(description="ELv from the volume's edges (Table 8.2) [µm]")
    ELSv_um: Micro = Field(description="ELSv, with straightness and squareness (Table 8.2) [µm]")
    ratios: dict[str, Digits | None] = Field(
        description="Multiple factors M1 = ELSv/ELv, M2 = ELSv/Ed, M3 = ELSv/ESd; null where a "
        "measure is 0",
        examples=[{"M1": 1.68, "M2": 1.41, "M3": 1.12}],
    )

    @classmethod
    def of(cls, head: dict[str, Any], volume: WorkVolume, accuracy: VolumetricAccuracy) -> Self:
        """Show what was found."""
        return cls(
            **head,
            volume=volume_of(volume),
            linear=SpreadAnswer.of(accuracy.linear),
            angular=AngularSpreadAnswer.of(accuracy.angular),
            with_arms=SpreadAnswer.of(accuracy.with_arms),
            diagonals_um=dict(accuracy.diagonals.ranges_um),
            Ed_um=accuracy.diagonals.ed_um,
            ESd_um=accuracy.diagonals.esd_um,
            ELv_um=accuracy.lines.elv_um,
            ELSv_um=accuracy.lines.elsv_um,
            ratios={name: none_for_nan(ratio) for name, ratio in accuracy.ratios.items()},
        )


class LinesRequest(Schema):
    """Maximal deviations on lines along the axes."""

    model_config = ConfigDict(
        json_schema_extra={
            "example": {
                "linear_um": {"x": [9.5, 7.2], "y": [15.8, 12.0], "z": [14.3, 25.2]},
                "straightness_um": {
                    "EYX": 2.9, "EZX": 2.4, "EXY": 2.4, "EZY": 2.3, "EXZ": 15.9, "EYZ": 6.1,
                },
            }
        }
    )  # fmt: skip

    linear_um: dict[str, Lines] = Field(
        description="Axis to the maximal deviation of positioning on each line along it [µm]"
    )
    straightness_um: dict[str, Deviation] = Field(
        description="The maximal deviation of each of the six straightness errors, squareness "
        "included [µm]"
    )


class LevelsRequest(AccuracyRequest):
    """The same, with the size of the lattice of points that is looked at."""

    points_per_axis: Annotated[Integer, Field(ge=2, le=60)] = Field(
        11, description="Number of points along each axis of an even lattice over the volume"
    )


class LevelTable(Schema):
    """One table of a controller."""

    component: str = Field(description="ISO 230-1 code", examples=["EXY"])
    chapter: str = Field(description="The chapter's notation", examples=["D_x(y)"])
    axis: str = Field(description="Axis of the positions", examples=["y"])
    positions_mm: list[Number] = Field(description="Positions on the axis [mm]")
    errors_um: list[Micro] | None = Field(
        None, description="Errors, squareness folded in where the level says so [µm]"
    )
    errors_urad: list[Micro] | None = Field(None, description="Angular errors [µrad]")
    slopes_um_per_m: list[Micro] | None = Field(None, description="Nonrigid slopes [µm/m]")
    slopes_urad_per_m: list[Micro] | None = Field(None, description="Nonrigid slopes [µrad/m]")
    compensation_um: list[Micro] | None = Field(None, description="Minus the error [µm]")
    compensation_urad: list[Micro] | None = Field(None, description="Minus the error [µrad]")
    compensation_um_per_m: list[Micro] | None = Field(None, description="Minus the slope [µm/m]")
    compensation_urad_per_m: list[Micro] | None = Field(
        None, description="Minus the slope [µrad/m]"
    )

    @classmethod
    def of(cls, code: str, table: Table) -> Self:
        """Show a table."""
        component = COMPONENTS[code]
        errors = np.asarray(table.values)
        numbers: dict[str, Any] = {
            component.error_field: errors.tolist(),
            component.compensation_field: (0.0 - errors).tolist(),
        }
        return cls(
            component=code,
            chapter=component.chapter,
            axis=str(component.axis),
            positions_mm=np.asarray(table.positions_mm).tolist(),
            **numbers,
        )


class LevelAnswer(Schema):
    """What a controller of one ability takes away, and what it leaves."""

    level: str = Field(
        description="`nothing`, `displacement` (8.89–8.91), `straightness` with squareness folded "
        "in (8.92–8.94), `angular` (8.95–8.97) or `nonrigid` (8.98–8.100)",
        examples=["straightness"],
    )
    mean_um: Micro = Field(
        description="Mean length of the volumetric error that is left at the lattice's points [µm]"
    )
    rms_um: Micro = Field(description="Its root mean square at these points [µm]")
    max_um: Micro = Field(description="Its largest anywhere in the volume [µm]")
    within_um: Digits | None = Field(
        description="What the true largest may be beyond `max_um` [µm]; null where the tables have "
        "too many nodes for that: `max_um` is then sampled, the largest at the lattice's points"
    )
    tables: list[LevelTable] = Field(description="The tables that such a controller needs")

    @classmethod
    def of(cls, level: CompensationLevel) -> Self:
        """Show a level."""
        return cls(
            level=level.level,
            mean_um=level.mean_um,
            rms_um=level.rms_um,
            max_um=level.max_um,
            within_um=level.within_um,
            tables=[LevelTable.of(code, table) for code, table in level.tables.items()],
        )


class LevelsAnswer(AnswerHead):
    """What each kind of controller would leave over the volume."""

    volume: dict[str, TravelSchema] = Field(description="The work volume [mm]")
    levels: list[LevelAnswer] = Field(description="From nothing to everything")


def volume_of(volume: WorkVolume) -> dict[str, TravelSchema]:
    """Show a work volume; an axis that the machine lacks has no range."""
    return {
        axis: TravelSchema(min_mm=low, max_mm=high)
        for axis, (low, high) in zip("xyz", volume.ranges_mm, strict=True)
        if low < high
    }


def none_for_nan(ratio: float) -> float | None:
    """Give null for what JSON cannot carry."""
    return None if math.isnan(ratio) else ratio
