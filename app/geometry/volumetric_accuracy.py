"""Every definition of volumetric accuracy, over a work volume at one thermal state.

C. Wang, 8.5: the sums 8.112–8.117, definition 1 (8.118–8.121), definition 2
(8.122–8.129), Ed and ESd from the body diagonals (8.130 ff.), ELv and ELSv from lines
(Table 8.2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from app.answer import Answer, Vector
from app.geometry.body_diagonal import (
    DiagonalAccuracy,
    diagonal_accuracy,
    extreme_displacements,
)
from app.geometry.box_extremes import BoxExtremes, box_extremes, ends_of_pieces, error_extremes
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, Component
from app.geometry.error_field import ErrorField
from app.geometry.line_accuracy import STRAIGHTNESS_CODES, LineAccuracy, line_accuracy
from app.geometry.volumetric_error import NO_TOOL
from app.geometry.work_volume import WorkVolume, points_of
from app.rounding import Digits, Micro

MicroVector: TypeAlias = Annotated[Sequence[Micro], Field(min_length=3, max_length=3)]


@dataclass(frozen=True)
class Spread(Answer, published_as="SpreadAnswer"):
    """How far three sums of errors spread over the volume."""

    ranges: Annotated[MicroVector, Field(alias="ranges_um")]
    """Largest less smallest value in x, y, z (8.122–8.127) [µm]"""
    definition_1: Annotated[Micro, Field(alias="definition_1_um")]
    """Largest root of the sum of squares of x, y, z (8.118–8.121) [µm]"""
    definition_2: Annotated[Micro, Field(alias="definition_2_um")]
    """Root of the sum of squares of the ranges (8.128) [µm]"""
    worst_point_mm: Vector
    """Where definition 1 has its largest [mm]"""
    within: Annotated[Digits, Field(alias="within_um")]
    """What the true ranges and definitions may be beyond these: they are extremes of the model over
    the whole volume, not of samples [µm]"""

    @classmethod
    def of_box(cls, extremes: BoxExtremes) -> Self:
        """Sum up the extremes of a vector over the work volume."""
        x, y, z = (float(range_) for range_ in extremes.most - extremes.least)
        a, b, c = (float(coordinate) for coordinate in extremes.where_mm)
        # A range has an extreme at either end, definition 2 three ranges.
        within = 2.0 * math.sqrt(3.0) * extremes.within
        return cls((x, y, z), extremes.longest, math.hypot(x, y, z), (a, b, c), within)


@dataclass(frozen=True)
class AngularSpread(Spread, published_as="AngularSpreadAnswer"):
    """The same of angles."""

    ranges: Annotated[MicroVector, Field(alias="ranges_urad")]
    """Largest less smallest value about x, y, z (8.122–8.127) [µrad]"""
    definition_1: Annotated[Micro, Field(alias="definition_1_urad")]
    """Largest root of the sum of squares (8.119, 8.121) [µrad]"""
    definition_2: Annotated[Micro, Field(alias="definition_2_urad")]
    """Root of the sum of squares of the ranges (8.129) [µrad]"""
    within: Annotated[float, Field(exclude=True)]


@dataclass(frozen=True, slots=True)
class VolumetricAccuracy:
    """All definitions at one thermal state.

    Parameters
    ----------
    linear
        Of the sums 8.112–8.114 as printed: EXX + EXY + EXZ …, squareness included,
        without lever arms [µm].
    angular
        Of the sums 8.115–8.117: EAX + EAY + EAZ … [µrad].
    with_arms
        Of the volumetric error at the tool, lever arms and tool offset included [µm].
    """

    linear: Spread
    angular: AngularSpread
    with_arms: Spread
    diagonals: DiagonalAccuracy
    lines: LineAccuracy

    @property
    def ratios(self) -> dict[str, float | None]:
        """The chapter's multiple factors M1 to M3; None where a measure is 0."""
        below = {
            "M1": self.lines.elv_um,
            "M2": self.diagonals.ed_um,
            "M3": self.diagonals.esd_um,
        }
        return {name: self.lines.elsv_um / um if um else None for name, um in below.items()}


def volumetric_accuracy(
    field: ErrorField,
    volume: WorkVolume,
    tool_offset_mm: ArrayLike = NO_TOOL,
) -> VolumetricAccuracy:
    """Measure a machine's volumetric accuracy by every definition of the chapter.

    Parameters
    ----------
    tool_offset_mm : array-like, shape (3,) [mm]

    Raises
    ------
    InvalidContent
        If the field has several thermal states, or its nodes in the volume are too many.

    Notes
    -----
    All are true extremes, not those of samples. `linear` and `angular` are straight
    lines of each coordinate between the tables' nodes, so that their ranges and lengths
    have their extremes at nodes; `with_arms` may be a parabola there, of which
    `box_extremes` finds the extremes within a fiftieth of a nanometre. The body
    diagonals are cubics between nodes, whose extremes are where their slope is 0.
    """
    field.expect_one_state()
    translations = field.only(lambda component: not component.is_rotation)
    # Neither sum has a lever arm, so that between nodes both are straight along each coordinate.
    # With nonrigid slopes they are bilinear: table by coordinate of another axis, each of degree 1.
    straight = (1, 1, 1)
    return VolumetricAccuracy(
        linear=Spread.of_box(
            box_extremes(lambda points: translations.at(points)[0], field, volume, straight)
        ),
        angular=AngularSpread.of_box(box_extremes(field.rotation_at, field, volume, straight)),
        with_arms=Spread.of_box(error_extremes(field, volume, tool_offset_mm)),
        diagonals=diagonal_accuracy(extreme_displacements(field, volume, tool_offset_mm)),
        lines=model_line_accuracy(field, volume, tool_offset_mm),
    )


def model_line_accuracy(
    field: ErrorField, volume: WorkVolume, tool_offset_mm: ArrayLike = NO_TOOL
) -> LineAccuracy:
    """Say which ELv and ELSv would be measured on a machine with these errors.

    Parameters
    ----------
    tool_offset_mm : array-like, shape (3,) [mm]
        Tool offset T of the reflector.

    Returns
    -------
    LineAccuracy
        The lines are the four edges of the volume along each axis (the chapter
        measured up to three), with the rotations' effect on them; straightness is each
        straightness table with its squareness (8.58–8.60), as in Table 8.2.
    """
    linear = {
        axis: _edge_deviations(field, volume, i, tool_offset_mm)
        for i, axis in enumerate(LINEAR_LETTERS)
    }
    straightness = {code: _straightness(field, volume, code) for code in STRAIGHTNESS_CODES}
    return line_accuracy(linear, straightness)


def _edge_deviations(
    field: ErrorField, volume: WorkVolume, i: int, tool_offset_mm: ArrayLike
) -> list[float]:
    """Range of the error in direction i along each of the four edges in direction i [µm].

    No rotation moves along its own arm, so that this is a straight line between nodes.
    """
    coordinates = [np.array(ends) for ends in volume.ranges_mm]
    coordinates[i] = ends_of_pieces(field, LINEAR_LETTERS[i], volume.ranges_mm[i])
    errors_um, _ = field.at(points_of(*coordinates), tool_offset_mm)
    along = errors_um[:, i].reshape([c.size for c in coordinates])
    return [float(deviation) for deviation in np.ptp(along, axis=i).ravel()]


def _straightness(field: ErrorField, volume: WorkVolume, code: str) -> float:
    """Range of one straightness error with its squareness over the volume [µm]."""
    wanted = COMPONENTS[code]

    def belongs(component: Component) -> bool:
        # E_x(y) has SXY·y in it (8.58–8.60): the squareness that grows with the same coordinate,
        # and below displaces in the same direction.
        squareness = component.axis is None and component.times == wanted.axis
        return component.direction == wanted.direction and (component.code == code or squareness)

    i = LINEAR_LETTERS.index(str(wanted.axis))
    along = ends_of_pieces(field, str(wanted.axis), volume.ranges_mm[i])
    points = np.zeros((along.size, 3))
    points[:, i] = along
    errors_um, _ = field.only(belongs).at(points)
    return float(np.ptp(errors_um[:, LINEAR_LETTERS.index(wanted.direction)]))
