"""Lines of points as plotly draws them: rounded numbers, many lines in one trace."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from app.arrays import FloatArray
from app.geometry.components import LINEAR_LETTERS
from app.geometry.work_volume import WorkVolume
from app.pictures.colours import QUIET
from app.pictures.distorted_volume import DrawnPoints

Trace: TypeAlias = dict[str, Any]
"""One thing that plotly draws, in the words of its JSON."""

COLOUR_AXIS: Final = "coloraxis"
"""The one colour scale that all traces share."""

DIGITS_MM: Final = 6
"""Of coordinates, counted from the volume's diagonal: far finer than a pixel."""

DIGITS_UM: Final = 5
"""Of errors, counted from the largest one."""

SHOWN_UM: Final = 3
"""Of errors, in text; a tenth of a µm always."""

GAP: Final = (0.0,) * 7
"""Between two lines of one trace there is no point, but plotly counts one."""


@dataclass(frozen=True, slots=True)
class Rounding:
    """How many decimals the picture's numbers need.

    Parameters
    ----------
    shown_um
        Decimals of errors where people read them.
    """

    mm: int
    um: int
    shown_um: int

    @classmethod
    def of(cls, volume: WorkVolume, largest_um: float) -> Rounding:
        """Choose decimals for a volume and its largest error.

        Parameters
        ----------
        largest_um
            Length of the largest error in it [µm].

        Examples
        --------
        >>> Rounding.of(WorkVolume((0.0, 300.0), (0.0, 400.0), (0.0, 1200.0)), 43.2)
        Rounding(mm=2, um=3, shown_um=1)
        """
        return cls(
            _decimals(volume.diagonal_mm, DIGITS_MM),
            _decimals(largest_um, DIGITS_UM),
            max(_decimals(largest_um, SHOWN_UM), 1),
        )


def plain_lines(lines: Sequence[FloatArray], rounding: Rounding, width_px: float) -> Trace:
    """Put lines into one trace that shows nothing under the mouse.

    Parameters
    ----------
    lines
        Each an ndarray of shape (n, 3) [mm].

    Returns
    -------
    Trace
        x, y, z [mm], a gap between one line and the next.
    """
    return {
        "type": "scatter3d",
        "mode": "lines",
        **dict(zip(LINEAR_LETTERS, _columns(lines, rounding.mm), strict=True)),
        "line": {"width": width_px, "color": QUIET},
        "hoverinfo": "skip",
    }


def error_lines(lines: Sequence[DrawnPoints], rounding: Rounding, width_px: float) -> Trace:
    """Put lines into one trace, coloured by the length of their errors.

    Parameters
    ----------
    lines
        Points of each line in their order.

    Returns
    -------
    Trace
        x, y, z as drawn [mm], a gap between one line and the next; colours are lengths
        [µm]; `customdata` has what `rows_of` writes of each point, 0 in a gap.
    """
    rows = [row for line in lines for row in [*rows_of(line, rounding), GAP]][:-1]
    return {
        **plain_lines([line.drawn_mm for line in lines], rounding, width_px),
        "line": {"width": width_px, "color": [row[-1] for row in rows], "coloraxis": COLOUR_AXIS},
        "hoverinfo": "all",
        **hover(rows, rounding),
    }


def rows_of(points: DrawnPoints, rounding: Rounding) -> list[list[float]]:
    """Write down what hovering over points shows.

    Returns
    -------
    list of list of float
        Nominal x, y, z [mm], error x, y, z and its length [µm] of each point.
    """
    nominal = points.points_mm.round(rounding.mm)
    errors = np.column_stack([points.errors_um, points.lengths_um]).round(rounding.um)
    rows: list[list[float]] = _without_negative_zero(np.hstack([nominal, errors])).tolist()
    return rows


def hover(rows: Sequence[Sequence[float]], rounding: Rounding) -> Trace:
    """Say what is shown at each vertex under the mouse.

    Returns
    -------
    Trace
        `customdata` and `hovertemplate`.
    """
    places = " ".join(f"{a.upper()} %{{customdata[{i}]:~f}}" for i, a in enumerate(LINEAR_LETTERS))
    errors = "<br>".join(
        f"{name} %{{customdata[{i}]:{sign}.{rounding.shown_um}f}} µm"
        for i, name, sign in ((3, "ex", "+"), (4, "ey", "+"), (5, "ez", "+"), (6, "length", ""))
    )
    return {
        "customdata": rows,
        "hovertemplate": f"{places} mm<br>{errors}<extra></extra>",
    }


def _columns(lines: Sequence[FloatArray], decimals: int) -> list[list[float | None]]:
    """The columns of all lines, one after the other; JSON knows no NaN, so a gap is None."""
    gap = np.full((1, lines[0].shape[1]), None)
    parts: list[NDArray[Any]] = []
    for line in lines:
        parts += [_without_negative_zero(line.round(decimals)).astype(object), gap]
    columns: list[list[float | None]] = np.concatenate(parts[:-1]).T.tolist()
    return columns


def _without_negative_zero(values: FloatArray) -> FloatArray:
    """Rounded −0.001 would be shown as −0."""
    return values + 0.0


def _decimals(largest: float, digits: int) -> int:
    """Decimals of numbers of which the largest has so many digits, never above 12."""
    if not largest > 0:
        return 0
    return min(max(digits - 1 - math.floor(math.log10(largest)), 0), 12)
