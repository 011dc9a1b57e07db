"""The tables of all components of one axis, packed so that one search serves them all.

A position is found among the nodes by arithmetic instead of bisection: buckets of
equal width, narrow enough for one node each, say how many nodes lie before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from app.arrays import FloatArray, IntArray

MOST_BUCKETS: Final = 8192
"""Nodes so unevenly spaced that they need more are searched by bisection."""

FARTHEST_MM: Final = 1e9
"""Positions further away than a thousand kilometres are none of a machine tool."""

CLOSEST_MM: Final = 1e-6
"""Positions of one table that are closer than a nanometre are one position."""


@dataclass(frozen=True, slots=True)
class Located:
    """Where positions lie: how many nodes are not after each, and how far behind the last."""

    count: IntArray
    beyond_mm: FloatArray


class NodeSearch:
    """Count the nodes that are not after a position.

    Parameters
    ----------
    nodes_mm : ndarray, shape (k,) [mm]
        Strictly increasing, at least one.
    """

    def __init__(self, nodes_mm: FloatArray) -> None:
        self.nodes_mm = nodes_mm
        # Place i: what a position with i nodes before it counts from. With none it is the first
        # node.
        self._origins_mm = np.concatenate([nodes_mm[:1], nodes_mm])
        span = float(nodes_mm[-1] - nodes_mm[0])
        gaps = np.diff(nodes_mm)
        # Buckets half as wide as the narrowest gap, where so many may be: two nodes are never in
        # one then, however it is rounded.
        self._per_mm = min(2.0 / float(gaps.min()), MOST_BUCKETS / span) if gaps.size else 0.0
        home = self._bucket(nodes_mm)
        # Two nodes in one bucket: only bisection can tell them apart.
        self._bisects = bool((np.diff(home) == 0).any())
        self._before = np.searchsorted(home, np.arange(home[-1] + 1))
        self._next_mm = nodes_mm[self._before]

    def locate(self, positions_mm: FloatArray) -> Located:
        """Find positions among the nodes.

        Parameters
        ----------
        positions_mm : ndarray, shape (n,) [mm]
            Positions within ±FARTHEST_MM.

        Returns
        -------
        Located
            How many nodes, 0 to k, lie at or before each position, and how far it is
            behind the last of them; before the first node the distance counts from it.
        """
        if self._bisects:
            count = np.searchsorted(self.nodes_mm, positions_mm, side="right")
        else:
            # The bucket rises with the position, rounded or not: nodes of earlier buckets lie
            # before it, nodes of later ones behind it, and one comparison decides the rest.
            bucket = self._bucket(positions_mm)
            count = self._before.take(bucket, mode="clip")
            count += positions_mm >= self._next_mm.take(bucket, mode="clip")
        origin_mm = self._origins_mm.take(count, mode="clip")
        return Located(count, np.subtract(positions_mm, origin_mm, out=origin_mm))

    def _bucket(self, positions_mm: FloatArray) -> IntArray:
        scaled = positions_mm - self.nodes_mm[0]
        scaled *= self._per_mm
        bucket: IntArray = scaled.astype(np.intp)
        return bucket


class AxisTable:
    """All tables of one axis on the union of their positions, for one state or several.

    Parameters
    ----------
    nodes_mm : ndarray, shape (k,) [mm]
        Union of the components' positions, strictly increasing, at least one.
    blocks
        What the errors multiply (None, or a coordinate for slopes) to ndarray, shape
        (s, 6, k): the six errors at the nodes in each of s states.
    """

    def __init__(self, nodes_mm: FloatArray, blocks: Mapping[str | None, FloatArray]) -> None:
        self.locate = NodeSearch(nodes_mm).locate
        self._lines = {times: _as_lines(nodes_mm, block) for times, block in blocks.items()}

    def read(self, state: int, located: Located) -> dict[str | None, FloatArray]:
        """Interpolate all errors of one state at located positions.

        Returns
        -------
        dict of what the errors multiply to ndarray, shape (6, n)
        """
        motion: dict[str | None, FloatArray] = {}
        for times, lines in self._lines.items():
            line = lines[state].take(located.count, axis=1, mode="clip")
            values = line[..., 1] * located.beyond_mm
            values += line[..., 0]
            motion[times] = values
        return motion


def _as_lines(nodes_mm: FloatArray, values: FloatArray) -> FloatArray:
    """The value and the slope behind each node, side by side: shape (s, 6, k + 1, 2).

    The first row serves positions before the first node, and there as behind the last
    node the value holds.
    """
    # Line i serves where i nodes lie before. Lines 0 and k have slope 0 and the value of an end, so
    # that a position outside the table needs no comparison of its own.
    lines = np.zeros((*values.shape[:2], nodes_mm.size + 1, 2))
    lines[..., 0, 0] = values[..., 0]
    lines[..., 1:, 0] = values
    lines[..., 1:-1, 1] = np.diff(values) / np.diff(nodes_mm)
    return lines
