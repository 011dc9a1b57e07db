"""Three slices of the work volume as a draughtsman lays them out: top, front and right side.

Flat drawings need no WebGL. A slice shows the displacement in its plane; what is at right angles
to it is seen in the other two.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray
from app.geometry.components import LINEAR_LETTERS
from app.geometry.error_field import ErrorField
from app.geometry.volumetric_error import NO_TOOL
from app.geometry.work_volume import WorkVolume
from app.units import UM_PER_MM

LINES: Final = 6
"""Grid lines in each direction, both edges among them."""

POINTS: Final = 31
"""Points of a line: tables are straight between their nodes, and few have more on one axis."""

VIEWS: Final = (("Top", 0, 1), ("Front", 0, 2), ("Side", 1, 2))
"""Name, and the axes to the right and upwards."""


@dataclass(frozen=True, slots=True, eq=False)
class Slice:
    """One slice.

    Parameters
    ----------
    across, up
        Index of the axis to the right, and upwards.
    at_mm
        Where it lies on the third axis [mm].
    nominal, real
        Lines in its plane, each of shape (n, 2) [mm], real ones with the error exaggerated.
    ringed
        The nominal and the real place of the largest error in it, shape (2, 2) [mm]; None where
        that does not lie in it.
    """

    name: str
    across: int
    up: int
    at_mm: float
    nominal: Sequence[FloatArray]
    real: Sequence[FloatArray]
    ringed: FloatArray | None

    @property
    def third(self) -> int:
        """Index of the axis at right angles to it."""
        return 3 - self.across - self.up

    @property
    def plane(self) -> str:
        """Name its axes, as in `XZ`."""
        return f"{LINEAR_LETTERS[self.across]}{LINEAR_LETTERS[self.up]}".upper()


def slice_volume(
    field: ErrorField,
    volume: WorkVolume,
    through_mm: Sequence[float],
    exaggeration: float,
    tool_offset_mm: ArrayLike = NO_TOOL,
    worst_mm: Sequence[float] | None = None,
) -> list[Slice]:
    """Cut the work volume along three planes through one point.

    Parameters
    ----------
    through_mm
        The point x, y, z that all three contain [mm].
    exaggeration
        How many times larger than it is the error is drawn.
    tool_offset_mm : array-like, shape (3,) [mm]
    worst_mm
        The place of the largest error, where it is to be marked [mm].

    Returns
    -------
    list of Slice
        Top, front and side.
    """

    def real(points_mm: FloatArray) -> FloatArray:
        errors_um, _ = field.at(points_mm, tool_offset_mm)
        moved: FloatArray = points_mm + exaggeration * errors_um / UM_PER_MM
        return moved

    slices = []
    for name, across, up in VIEWS:
        axes, third = [across, up], 3 - across - up
        lines = list(_lines(volume, through_mm, across, up))
        ringed = None
        if worst_mm is not None and np.isclose(worst_mm[third], through_mm[third]):
            point = np.array([worst_mm])
            ringed = np.vstack([point, real(point)])[:, axes]
        slices.append(
            Slice(
                name=name,
                across=across,
                up=up,
                at_mm=float(through_mm[third]),
                nominal=[line[[0, -1]][:, axes] for line in lines],
                real=[real(line)[:, axes] for line in lines],
                ringed=ringed,
            )
        )
    return slices


def _lines(
    volume: WorkVolume, through_mm: Sequence[float], across: int, up: int
) -> Iterator[FloatArray]:
    """Give the grid's lines, shape (n, 3) [mm]; edges first and last of each direction."""
    for along, beside in ((across, up), (up, across)):
        for at_mm in np.linspace(*volume.ranges_mm[beside], LINES):
            points = np.tile(np.asarray(through_mm, dtype=float), (POINTS, 1))
            points[:, along] = np.linspace(*volume.ranges_mm[along], POINTS)
            points[:, beside] = at_mm
            yield points
