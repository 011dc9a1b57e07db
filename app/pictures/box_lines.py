"""The lines of a box: its edges, and lines across each of its faces."""

from __future__ import annotations

from itertools import product
from typing import Final, TypeAlias

import numpy as np

from app.arrays import FloatArray
from app.geometry.components import LINEAR_LETTERS
from app.geometry.error_field import ErrorField
from app.geometry.work_volume import WorkVolume

Counts: TypeAlias = tuple[int, int, int]
"""Points along x, y and z."""

EVEN_POINTS: Final = 17
"""On every line beside the tables' nodes: between two nodes an error can be a parabola."""

MOST_NODES: Final = 25
"""Of an axis' tables, on every line; of more than these some are left out."""

MOST_TIMES: Final = 4
"""More points than so many times the usual number are put on no axis."""


def points_along_axes(volume: WorkVolume, usual: int) -> Counts:
    """Give long axes more points of a lattice than short ones.

    Parameters
    ----------
    usual
        Points along each axis of a cube, at least 2.

    Returns
    -------
    tuple of int
        Points along x, y and z: in proportion to the root of a side's length, so that
        a gantry's cells become neither slices nor too many. At least 2, and 1 on a
        missing axis.

    Examples
    --------
    >>> points_along_axes(WorkVolume((0.0, 500.0), (0.0, 500.0), (0.0, 400.0)), 5)
    (5, 5, 5)
    >>> points_along_axes(WorkVolume((0.0, 30_000.0), (0.0, 4000.0), (-1500.0, 0.0)), 5)
    (12, 4, 3)
    """
    sides = np.array([high - low for low, high in volume.ranges_mm])
    mean = np.exp(np.mean(np.log(sides[sides > 0])))
    counts = np.clip(np.round(usual * np.sqrt(sides / mean)), 2, MOST_TIMES * usual)
    x, y, z = (int(count) for count in np.where(sides > 0, counts, 1))
    return x, y, z


def box_edges(volume: WorkVolume, field: ErrorField | None = None) -> list[FloatArray]:
    """Give the edges of the work volume, each as one line of points.

    Parameters
    ----------
    volume
        The work volume; a missing axis leaves four edges, two missing ones leave one.
    field
        Errors whose tables' nodes the lines pass; without them the ends will do.

    Returns
    -------
    list of ndarray, shape (n, 3) [mm]
        The edges along x, then along y, then along z.

    Examples
    --------
    >>> lathe = WorkVolume((0.0, 200.0), (0.0, 0.0), (0.0, 400.0))
    >>> box_edges(lathe)[0].tolist()
    [[0.0, 0.0, 0.0], [200.0, 0.0, 0.0]]
    >>> len(box_edges(lathe))
    4
    """
    ends = [np.unique(range_) for range_ in volume.ranges_mm]
    return [
        line for along in _axes_with_length(volume) for line in _lines(volume, along, ends, field)
    ]


def face_lines(volume: WorkVolume, field: ErrorField, counts: Counts) -> list[FloatArray]:
    """Give the lines across the faces of the work volume, each as one line of points.

    Parameters
    ----------
    volume
        The work volume; a flat one has one face.

    Returns
    -------
    list of ndarray, shape (n, 3) [mm]
        No edges among them.
    """
    ends = [np.unique(range_) for range_ in volume.ranges_mm]
    lines: list[FloatArray] = []
    for along in _axes_with_length(volume):
        for across in _axes_with_length(volume):
            if across != along:
                places = [*ends]
                places[across] = np.linspace(*volume.ranges_mm[across], counts[across])[1:-1]
                lines += _lines(volume, along, places, field)
    return lines


def _axes_with_length(volume: WorkVolume) -> list[int]:
    return [i for i, (low, high) in enumerate(volume.ranges_mm) if low < high]


def _lines(
    volume: WorkVolume, along: int, places: list[FloatArray], field: ErrorField | None
) -> list[FloatArray]:
    """All lines along one axis through the places on the two others."""
    positions = _positions(volume, along, field)
    others = [j for j in range(3) if j != along]
    drawn_lines = []
    for place in product(*(places[j] for j in others)):
        line = np.empty((positions.size, 3))
        line[:, along] = positions
        line[:, others] = place
        drawn_lines.append(line)
    return drawn_lines


def _positions(volume: WorkVolume, along: int, field: ErrorField | None) -> FloatArray:
    low, high = volume.ranges_mm[along]
    if field is None:
        return np.array([low, high])
    nodes = field.nodes_mm(LINEAR_LETTERS[along])
    inside = nodes[(nodes > low) & (nodes < high)]
    if inside.size > MOST_NODES:
        inside = inside[np.linspace(0, inside.size - 1, MOST_NODES).round().astype(int)]
    return np.union1d(inside, np.linspace(low, high, EVEN_POINTS))
