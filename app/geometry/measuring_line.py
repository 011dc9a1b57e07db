"""The line along which an axis' translations were measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from app.errors import InvalidContent
from app.geometry.components import LINEAR_LETTERS
from app.geometry.error_table import bounded

Triple: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class MeasuringLine:
    """Where an axis' translations were measured: they contain its rotations' effect there.

    Away from that line only the difference of the lever arms counts,
    a_u(p) + T − (a_u(line) + T_line) (Y.-Y. Hsu 2011, 17–25; C. Wang, 8.2.3). Angular
    errors that have nonrigid slopes are taken as measured on the same line.

    Parameters
    ----------
    point_mm
        A point x, y, z of the line [mm]; the coordinate along the axis itself does not
        matter.
    tool_offset_mm
        Tool offset T_line with which it was measured [mm].
    """

    point_mm: Triple
    tool_offset_mm: Triple = (0.0, 0.0, 0.0)

    @classmethod
    def make(
        cls, axis: str, point_mm: ArrayLike, tool_offset_mm: ArrayLike = (0.0, 0.0, 0.0)
    ) -> MeasuringLine:
        """Take a line as a user states it.

        Parameters
        ----------
        point_mm, tool_offset_mm : array-like, shape (3,) [mm]
            As above.

        Raises
        ------
        InvalidContent
            If there is no such axis, or a point has not three finite coordinates.

        Examples
        --------
        >>> MeasuringLine.make("x", [0, 250, 100]).point_mm
        (0.0, 250.0, 100.0)
        """
        field = f"measuring_lines_mm.{axis}"
        if axis not in LINEAR_LETTERS:
            raise InvalidContent.of_field(field, f"expected axis x, y or z, got {axis!r}")
        return cls(_triple(field, point_mm), _triple(field, tool_offset_mm))


MeasuringLines: TypeAlias = Mapping[str, MeasuringLine]
"""Axis to its measuring line; an axis without one has translations free of rotations."""


def _triple(field: str, stated_mm: ArrayLike) -> Triple:
    numbers = np.asarray(stated_mm, dtype=np.float64)
    if numbers.shape != (3,):
        raise InvalidContent.of_field(
            field, f"expected x, y and z of a point in mm, got {stated_mm!r}"
        )
    x, y, z = bounded(field, numbers).tolist()
    return (x, y, z)
