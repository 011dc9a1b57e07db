"""Every definition of volumetric accuracy, over a work volume at one thermal state.

C. Wang, 8.5: the sums 8.112–8.117, definition 1 (8.118–8.121), definition 2
(8.122–8.129), Ed and ESd from the body diagonals (8.130 ff.), ELv and ELSv from lines
(Table 8.2).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray
from app.errors import InvalidContent
from app.geometry.body_diagonal import (
    DiagonalAccuracy,
    diagonal_accuracy,
    diagonal_displacements,
)
from app.geometry.components import COMPONENTS, LINEAR_LETTERS, Component
from app.geometry.error_field import ErrorField
from app.geometry.line_accuracy import STRAIGHTNESS_CODES, LineAccuracy, line_accuracy
from app.geometry.polynomial_pieces import cut, degree_along
from app.geometry.volumetric_error import NO_TOOL
from app.geometry.work_volume import WorkVolume, points_of

POINTS_AT_ONCE: Final = 100_000
MOST_POINTS: Final = 20_000_000


@dataclass(frozen=True, slots=True)
class Spread:
    """How far three sums of errors spread over the work volume.

    Parameters
    ----------
    ranges
        Largest less smallest value of each (8.122–8.127) [µm or µrad].
    definition_1
        Largest root of the sum of the three squares (8.118–8.121; the text says RMS)
        [µm or µrad]. It depends on where the errors are 0.
    definition_2
        Root of the sum of the squares of the ranges (8.128, 8.129) [µm or µrad].
    worst_point_mm
        Where definition 1 finds its largest [mm].
    """

    ranges: tuple[float, float, float]
    definition_1: float
    definition_2: float
    worst_point_mm: tuple[float, float, float]


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
    diagonals
        Ed and ESd.
    lines
        ELv and ELSv.
    """

    linear: Spread
    angular: Spread
    with_arms: Spread
    diagonals: DiagonalAccuracy
    lines: LineAccuracy

    @property
    def ratios(self) -> dict[str, float]:
        """The chapter's multiple factors M1 to M3; NaN where a measure is 0."""
        below = {
            "M1": self.lines.elv_um,
            "M2": self.diagonals.ed_um,
            "M3": self.diagonals.esd_um,
        }
        return {name: self.lines.elsv_um / um if um else math.nan for name, um in below.items()}


def volumetric_accuracy(
    field: ErrorField,
    volume: WorkVolume,
    tool_offset_mm: ArrayLike = NO_TOOL,
    points_per_axis: int | None = None,
    diagonal_steps: int = 20,
) -> VolumetricAccuracy:
    """Measure a machine's volumetric accuracy by every definition of the chapter.

    Parameters
    ----------
    field
        The errors at one thermal state.
    volume
        The work volume.
    tool_offset_mm : array-like, shape (3,) [mm]
        Tool offset T.
    points_per_axis
        Size of an even lattice of points; by default the nodes of the axes' tables in
        the volume and its ends.
    diagonal_steps
        Number of steps on each body diagonal; the tables' nodes are looked at too.

    Returns
    -------
    VolumetricAccuracy

    Raises
    ------
    InvalidContent
        If the field has several thermal states, or the points would be too many.

    Notes
    -----
    With the tables' own nodes `linear` and `angular` are exact: between nodes the sums
    are straight lines of each coordinate, so ranges and lengths have their extremes at
    nodes. So is `with_arms` unless an axis turns its own offset (a parabola, of which
    ends and middle of every piece are looked at).
    """
    field.expect_one_state()
    coordinates = _coordinates(field, volume, points_per_axis)
    translations = field.only(lambda component: not component.is_rotation)
    linear, angular, with_arms = _Watch(), _Watch(), _Watch()
    for points in _slabs(coordinates):
        linear.look(points, translations.at(points)[0])
        angular.look(points, field.rotation_at(points))
        with_arms.look(points, field.at(points, tool_offset_mm)[0])
    displacements = diagonal_displacements(
        field, volume, diagonal_steps, tool_offset_mm, at_nodes=True
    )
    return VolumetricAccuracy(
        linear=linear.spread(),
        angular=angular.spread(),
        with_arms=with_arms.spread(),
        diagonals=diagonal_accuracy(displacements),
        lines=model_line_accuracy(field, volume, tool_offset_mm),
    )


def model_line_accuracy(
    field: ErrorField, volume: WorkVolume, tool_offset_mm: ArrayLike = NO_TOOL
) -> LineAccuracy:
    """Say which ELv and ELSv would be measured on a machine with these errors.

    Parameters
    ----------
    field
        The errors at one thermal state.
    volume
        The work volume.
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


class _Watch:
    """Remembers the smallest, the largest and the longest of what it sees."""

    def __init__(self) -> None:
        self.least = np.full(3, np.inf)
        self.most = np.full(3, -np.inf)
        self.longest = -1.0
        self.where = np.zeros(3)

    def look(self, points_mm: FloatArray, vectors: FloatArray) -> None:
        self.least = np.minimum(self.least, vectors.min(axis=0))
        self.most = np.maximum(self.most, vectors.max(axis=0))
        lengths = np.linalg.norm(vectors, axis=1)
        i = int(lengths.argmax())
        if lengths[i] > self.longest:
            self.longest, self.where = float(lengths[i]), points_mm[i]

    def spread(self) -> Spread:
        x, y, z = (float(range_) for range_ in self.most - self.least)
        a, b, c = (float(coordinate) for coordinate in self.where)
        return Spread((x, y, z), self.longest, math.hypot(x, y, z), (a, b, c))


def _coordinates(
    field: ErrorField, volume: WorkVolume, points_per_axis: int | None
) -> list[FloatArray]:
    found = []
    for axis, (low, high) in zip(LINEAR_LETTERS, volume.ranges_mm, strict=True):
        if low == high:
            found.append(np.array([low]))
        elif points_per_axis is None:
            ends = np.array([low, high])
            found.append(cut(ends, field.nodes_mm(axis), degree_along(field, axis)))
        else:
            found.append(np.linspace(low, high, points_per_axis))
    points = math.prod(c.size for c in found)
    if not 0 < points <= MOST_POINTS:
        raise InvalidContent.of_field(
            "points_per_axis", f"expected 1 to {MOST_POINTS} points in all, came {points}"
        )
    return found


def _slabs(coordinates: list[FloatArray]) -> Iterator[FloatArray]:
    """Yield all points with these coordinates, some planes of constant x at a time."""
    x, y, z = coordinates
    planes = max(POINTS_AT_ONCE // (y.size * z.size), 1)
    for start in range(0, x.size, planes):
        yield points_of(x[start : start + planes], y, z)


def _edge_deviations(
    field: ErrorField, volume: WorkVolume, i: int, tool_offset_mm: ArrayLike
) -> list[float]:
    """Range of the error in direction i along each of the four edges in direction i [µm]."""
    axis = LINEAR_LETTERS[i]
    ends = [np.array(ends) for ends in volume.ranges_mm]
    coordinates = [*ends]
    if ends[i][0] < ends[i][1]:
        coordinates[i] = cut(ends[i], field.nodes_mm(axis), degree_along(field, axis))
    errors_um, _ = field.at(points_of(*coordinates), tool_offset_mm)
    along = errors_um[:, i].reshape([c.size for c in coordinates])
    return [float(deviation) for deviation in np.ptp(along, axis=i).ravel()]


def _straightness(field: ErrorField, volume: WorkVolume, code: str) -> float:
    """Range of one straightness error with its squareness over the volume [µm]."""
    wanted = COMPONENTS[code]

    def belongs(component: Component) -> bool:
        squareness = component.axis is None and component.times == wanted.axis
        return component.direction == wanted.direction and (component.code == code or squareness)

    i = LINEAR_LETTERS.index(str(wanted.axis))
    low, high = volume.ranges_mm[i]
    nodes = field.nodes_mm(str(wanted.axis))
    points = np.zeros((nodes.size + 2, 3))
    points[:, i] = np.clip(np.concatenate([[low], nodes, [high]]), low, high)
    errors_um, _ = field.only(belongs).at(points)
    return float(np.ptp(errors_um[:, LINEAR_LETTERS.index(wanted.direction)]))
