"""Errors as arrows: shafts in one trace, heads in another."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.arrays import FloatArray
from app.geometry.work_volume import points_of
from app.pictures.box_lines import Counts
from app.pictures.distorted_volume import DistortedVolume, DrawnPoints
from app.pictures.traces import COLOUR_AXIS, Rounding, Trace, error_lines, hover, rows_of

HEAD_SHARE: Final = 0.35
"""Length of a head, of its arrow."""

WIDTH_SHARE: Final = 0.36
"""Radius of a head's foot, of its length."""

SIDES: Final = 6
"""Of the pyramid that stands for a cone: at this size nobody sees the difference."""

SHAFT_PX: Final = 4

VECTORS: Final = "vectors"
"""What the legend shows and hides together."""

EVENLY_LIT: Final = {"ambient": 1.0, "diffuse": 0.0, "specular": 0.0, "fresnel": 0.0}
"""Colours mean lengths: light and shade would change them."""


def error_vectors(distorted: DistortedVolume, counts: Counts, rounding: Rounding) -> list[Trace]:
    """Draw the errors at a lattice of points, and the largest one, as arrows.

    Parameters
    ----------
    counts
        Points of the lattice along each axis, the volume's ends included.

    Returns
    -------
    list of Trace
        Shafts from each nominal point to nominal + exaggeration × error, and heads
        whose tips are there. An error that is drawn shorter than coordinates are
        rounded has no arrow; with none there is no trace.
    """
    points = _with_length(distorted.at(_lattice(distorted, counts)), rounding)
    if not len(points.points_mm):
        return []
    return [_shafts(points, rounding), _heads(points, rounding)]


def _lattice(distorted: DistortedVolume, counts: Counts) -> FloatArray:
    ranges = zip(distorted.volume.ranges_mm, counts, strict=True)
    lattice = points_of(*(np.linspace(low, high, count) for (low, high), count in ranges))
    return np.unique(np.vstack([lattice, distorted.worst_point_mm]), axis=0)


def _with_length(points: DrawnPoints, rounding: Rounding) -> DrawnPoints:
    lengths_mm = np.linalg.norm(points.drawn_mm - points.points_mm, axis=1)
    seen = lengths_mm > 10.0**-rounding.mm
    return DrawnPoints(points.points_mm[seen], points.errors_um[seen], points.drawn_mm[seen])


def _shafts(points: DrawnPoints, rounding: Rounding) -> Trace:
    """From the nominal to the drawn point; both ends show the same error."""
    ends = np.stack([points.points_mm, points.drawn_mm], axis=1)
    shafts = [
        DrawnPoints(points.points_mm[[i, i]], points.errors_um[[i, i]], drawn)
        for i, drawn in enumerate(ends)
    ]
    return {
        **error_lines(shafts, rounding, SHAFT_PX),
        "name": "error vectors",
        "legendgroup": VECTORS,
        "showlegend": False,
    }


def _heads(points: DrawnPoints, rounding: Rounding) -> Trace:
    """All heads as one mesh: of each a ring of vertices, then its tip."""
    vertices = np.concatenate([_feet(points), points.drawn_mm[:, np.newaxis]], axis=1)
    x, y, z = (vertices.reshape(-1, 3).round(rounding.mm) + 0.0).T.tolist()
    first = (SIDES + 1) * np.arange(len(vertices))[:, np.newaxis]
    left = np.arange(SIDES)
    right, tip = (left + 1) % SIDES, np.full(SIDES, SIDES)
    i, j, k = ((first + corner).ravel().tolist() for corner in (left, right, tip))
    rows = [row for row in rows_of(points, rounding) for _ in range(SIDES + 1)]
    return {
        "type": "mesh3d",
        **{"x": x, "y": y, "z": z, "i": i, "j": j, "k": k},
        "intensity": [row[-1] for row in rows],
        "coloraxis": COLOUR_AXIS,
        "lighting": EVENLY_LIT,
        "name": "error vectors",
        "legendgroup": VECTORS,
        "showlegend": False,
        **hover(rows, rounding),
    }


def _feet(points: DrawnPoints) -> FloatArray:
    """The rings at the heads' feet, shape (n, SIDES, 3) [mm]."""
    arrows = points.drawn_mm - points.points_mm
    lengths = np.linalg.norm(arrows, axis=1, keepdims=True)
    along = arrows / lengths
    across = np.cross(along, _least_along(along))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    angles = (2 * np.pi * np.arange(SIDES) / SIDES)[:, np.newaxis]
    ring = np.cos(angles) * across[:, np.newaxis]
    ring += np.sin(angles) * np.cross(along, across)[:, np.newaxis]
    middles = points.drawn_mm - HEAD_SHARE * arrows
    radii = WIDTH_SHARE * HEAD_SHARE * lengths
    feet: FloatArray = middles[:, np.newaxis] + radii[:, np.newaxis] * ring
    return feet


def _least_along(directions: FloatArray) -> FloatArray:
    """For each direction the axis to which it is the least parallel."""
    axes: FloatArray = np.eye(3)[np.abs(directions).argmin(axis=1)]
    return axes
