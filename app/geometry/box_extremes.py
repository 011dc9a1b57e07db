"""The true extremes of a model's errors over a work volume, not those of samples.

In every cell between the tables' nodes the error e(p) is a polynomial, of degree 1 or 2
along each coordinate (`polynomial_pieces`). Where all degrees are 1, extremes of its
components and of its length are at the cells' corners. Else Bernstein's coefficients c of
the cell hold them between bounds: e is everywhere a mean of them, so that

    min c_i ≤ e_i ≤ max c_i,     |e| ≤ max |c|     (the length is convex),

while the values at corners and middles are attained. Cells whose bound is beyond what is
attained elsewhere are halved along the coordinates of degree 2, which brings the bound
four times nearer each time, until none is left that could hold more than EXACT_WITHIN.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import BoolArray, FloatArray
from app.errors import InvalidContent
from app.geometry.components import LINEAR_LETTERS
from app.geometry.error_field import ErrorField
from app.geometry.polynomial_pieces import bernstein_coefficients, degree_along
from app.geometry.volumetric_error import NO_TOOL
from app.geometry.work_volume import WorkVolume, points_of

Vectors: TypeAlias = Callable[[FloatArray], FloatArray]
"""Points (n, 3) [mm] to vectors (n, 3) [µm or µrad]."""

EXACT_WITHIN: Final = 2e-5
"""What the extremes may be beyond what is found [µm or µrad]: a fiftieth of a nanometre."""

LEAST_RELATIVE: Final = 1e-12
"""Of errors so large that EXACT_WITHIN would be lost in rounding."""

POINTS_AT_ONCE: Final = 100_000
MOST_POINTS: Final = 20_000_000
MOST_CELLS: Final = 20_000
"""Cells that are looked into together. Beyond them the bound stays where it is, and is said."""

MOST_HALVINGS: Final = 40


@dataclass(frozen=True, slots=True, eq=False)
class BoxExtremes:
    """Extremes of a vector over a box.

    Parameters
    ----------
    least, most : ndarray, shape (3,)
        Smallest and largest value of each component that is attained [µm or µrad].
    longest
        Largest length that is attained [µm or µrad].
    where_mm : ndarray, shape (3,) [mm]
        Where it is.
    within
        What the true extremes may be beyond these: at most EXACT_WITHIN, unless the
        search had to end before [µm or µrad].
    """

    least: FloatArray
    most: FloatArray
    longest: float
    where_mm: FloatArray
    within: float


def box_extremes(
    vectors: Vectors, field: ErrorField, volume: WorkVolume, degrees: Sequence[int]
) -> BoxExtremes:
    """Find how small, how large and how long a model's vectors get in a box.

    Parameters
    ----------
    degrees
        Degree of the errors along x, y and z between those nodes, 1 or 2.

    Raises
    ------
    InvalidContent
        If nodes, ends and middles are too many.

    Examples
    --------
    A yaw of 10 to −10 µrad along a workpiece-side axis of −500 to 500 mm is the parabola
    −20 µm/m² x² in y, which is 0 between the nodes and nowhere else.

    >>> from app.geometry.chain import Chain
    >>> from app.geometry.error_table import Table
    >>> tables = {"ECX": Table([-500.0, 500.0], [10.0, -10.0])}
    >>> field = ErrorField.make(Chain.parse("XYFZ"), tables)
    >>> box = WorkVolume((-400.0, 500.0), (0.0, 0.0), (0.0, 0.0))
    >>> found = box_extremes(lambda p: field.at(p)[0], field, box, (2, 1, 1))
    >>> found.least[1].round(4).tolist(), found.most[1].round(4).tolist() + 0.0
    (-5.0, 0.0)
    """
    coordinates, curved = _coordinates(field, volume, degrees)
    points = math.prod(c.size for c in coordinates)
    if points > MOST_POINTS:
        raise InvalidContent.of_field(
            "volume",
            f"expected tables with at most {MOST_POINTS} nodes, ends and middles together in the "
            f"work volume, got {points}: ask for a part of it",
        )
    search = _Search(vectors, curved)
    step = max(POINTS_AT_ONCE // (coordinates[1].size * coordinates[2].size), 1)
    # Slabs of an even number of steps: along a coordinate of degree 2 ends and middles take turns,
    # and a slab has to begin and end with an end.
    step += step % 2
    # Neighbouring slabs share a face (+ 1 below): else the cells between them would be in neither.
    for start in range(0, max(coordinates[0].size - 1, 1), step):
        search.look([coordinates[0][start : start + step + 1], *coordinates[1:]])
    search.refine()
    return search.result()


def error_extremes(
    field: ErrorField, volume: WorkVolume, tool_offset_mm: ArrayLike = NO_TOOL
) -> BoxExtremes:
    """Find the extremes of the volumetric error at the tool, lever arms included.

    Parameters
    ----------
    tool_offset_mm : array-like, shape (3,) [mm]
    """
    degrees = [degree_along(field, axis) for axis in LINEAR_LETTERS]
    return box_extremes(lambda points: field.at(points, tool_offset_mm)[0], field, volume, degrees)


class _Search:
    """What was attained so far, and the cells that may hold more.

    Seven quantities are watched: each component, minus each, and the length.
    """

    def __init__(self, vectors: Vectors, curved: Sequence[bool]) -> None:
        self._vectors = vectors
        self._curved = curved
        self._degrees = [2 if bends else 1 for bends in curved]
        self._best = np.full(7, -np.inf)
        self._where_mm = np.zeros(3)
        self._given_up = 0.0
        self._cells = np.empty((0, 2, 3))
        self._bounds = np.empty((0, 7))

    def look(self, coordinates: list[FloatArray]) -> None:
        """Look at a lattice of ends and, along curved coordinates, middles of cells."""
        points = points_of(*coordinates)
        shape = (*(c.size for c in coordinates), 3)
        values = self._attain(points).reshape(shape)
        if any(self._curved):
            watched = _watched(bernstein_coefficients(values, self._degrees))
            for dimension, degree in enumerate(self._degrees):
                watched = _largest_of_cells(watched, dimension, degree)
            ends = [_ends(c, d) for c, d in zip(coordinates, self._degrees, strict=True)]
            low, high = (points_of(*side) for side in zip(*ends, strict=True))
            self._keep(np.stack([low, high], axis=1), watched.reshape(-1, 7))

    def refine(self) -> None:
        """Halve the cells that may hold more, until none may hold more than EXACT_WITHIN."""
        for _ in range(MOST_HALVINGS):
            self._prune()
            if not len(self._cells):
                return
            cells = _halved(self._cells, self._curved)
            # The whole cells' bounds are dropped: each half has coefficients of its own, which lie
            # nearer to the values.
            self._cells, self._bounds = cells[:0], self._bounds[:0]
            per_cell = math.prod(degree + 1 for degree in self._degrees)
            for part in np.array_split(cells, -(-len(cells) * per_cell // POINTS_AT_ONCE)):
                self._look_into(part)
        self._give_up(np.zeros(len(self._cells), dtype=bool))

    def result(self) -> BoxExtremes:
        """Say what was found."""
        best = self._best
        return BoxExtremes(
            # Minus the largest of minus the components; 0 − 0 is 0, where −(0) would be −0.
            least=0.0 - best[3:6],
            most=best[:3] + 0.0,
            longest=float(best[6]),
            where_mm=self._where_mm,
            within=max(self._given_up, float(self._slack().max()) if any(self._curved) else 0.0),
        )

    def _look_into(self, cells: FloatArray) -> None:
        low, high = cells[:, None, 0], cells[:, None, 1]
        sides = [np.linspace(0.0, 1.0, degree + 1) for degree in self._degrees]
        shares = points_of(*sides)
        points = low + shares * (high - low)
        values = self._attain(points.reshape(-1, 3))
        sizes = [side.size for side in sides]
        # Coefficients are formed along the first three dimensions: all cells go into the last one,
        # beside the components, and are turned at once.
        nets = np.moveaxis(values.reshape(-1, *sizes, 3), 0, -1).reshape(*sizes, -1)
        nets = bernstein_coefficients(nets, self._degrees).reshape(*sizes, 3, len(cells))
        bounds = _watched(np.moveaxis(nets, -1, 0)).max(axis=(1, 2, 3))
        self._keep(cells, bounds)

    def _attain(self, points_mm: FloatArray) -> FloatArray:
        values = self._vectors(points_mm)
        watched = _watched(values)
        best = watched.max(axis=0)
        if best[6] > self._best[6]:
            self._where_mm = points_mm[int(watched[:, 6].argmax())]
        self._best = np.maximum(self._best, best)
        return values

    def _slack(self) -> FloatArray:
        slack: FloatArray = np.maximum(EXACT_WITHIN, LEAST_RELATIVE * np.abs(self._best))
        return slack

    def _keep(self, cells: FloatArray, bounds: FloatArray) -> None:
        # A cell may go only where none of the seven can gain in it: the length can be largest where
        # no component is.
        may = (bounds > self._best + self._slack()).any(axis=1)
        self._cells = np.concatenate([self._cells, cells[may]])
        self._bounds = np.concatenate([self._bounds, bounds[may]])
        if len(self._cells) > MOST_CELLS:
            self._prune()

    def _prune(self) -> None:
        """Forget cells that hold nothing more; of too many, those that can hold least."""
        # `_best` has risen since these cells were taken in, so that some of them are settled by
        # now.
        beyond = (self._bounds - self._best - self._slack()).max(axis=1)
        open_cells = beyond > 0.0
        if np.count_nonzero(open_cells) > MOST_CELLS:
            # Half of what there is room for: with all of it the next cells would make us sort
            # again.
            most = np.argsort(beyond)[-MOST_CELLS // 2 :]
            promising = np.zeros(len(beyond), dtype=bool)
            promising[most] = True
            self._give_up(promising)
            open_cells &= promising
        self._cells, self._bounds = self._cells[open_cells], self._bounds[open_cells]

    def _give_up(self, open_cells: BoolArray) -> None:
        # What is not looked into any further may still hold so much more; the answer says it as
        # `within`.
        beyond = (self._bounds[~open_cells] - self._best).max(initial=0.0)
        self._given_up = max(self._given_up, float(beyond))


def _watched(vectors: FloatArray) -> FloatArray:
    """Components, minus components, length: all convex in the vector."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.concatenate([vectors, -vectors, lengths], axis=-1)


def _largest_of_cells(nets: FloatArray, dimension: int, degree: int) -> FloatArray:
    """Take the largest coefficient of each cell along one dimension of the lattice."""
    nets = np.moveaxis(nets, dimension, 0)
    if len(nets) > 1:
        last = len(nets) - degree
        shifted = [nets[i : i + last : degree] for i in range(degree + 1)]
        nets = np.maximum.reduce(shifted)
    return np.moveaxis(nets, 0, dimension)


def _ends(coordinates: FloatArray, degree: int) -> tuple[FloatArray, FloatArray]:
    """Give the lower and the upper ends of the cells along one coordinate."""
    if coordinates.size == 1:
        return coordinates, coordinates
    return coordinates[:-1:degree], coordinates[degree::degree]


def _halved(cells: FloatArray, curved: Sequence[bool]) -> FloatArray:
    """Cut cells in two along every coordinate of degree 2."""
    middles = cells.mean(axis=1)
    parts = []
    # Along a coordinate of degree 1 nothing is gained by halving: its extremes are at the ends.
    for upper in itertools.product(*((False, True) if bends else (None,) for bends in curved)):
        part = cells.copy()
        for i, half in enumerate(upper):
            if half is not None:
                part[:, 0 if half else 1, i] = middles[:, i]
        parts.append(part)
    return np.concatenate(parts)


def _coordinates(
    field: ErrorField, volume: WorkVolume, degrees: Sequence[int]
) -> tuple[list[FloatArray], list[bool]]:
    """Give the ends of the cells, with their middles where a coordinate is of degree 2."""
    nodes, curved = [], []
    for axis, ends, degree in zip(LINEAR_LETTERS, volume.ranges_mm, degrees, strict=True):
        coordinates = ends_of_pieces(field, axis, ends)
        curved.append(degree == 2 and coordinates.size > 1)
        if curved[-1]:
            middles = (coordinates[1:] + coordinates[:-1]) / 2
            coordinates = np.sort(np.concatenate([coordinates, middles]))
        nodes.append(coordinates)
    return nodes, curved


def lattice_size(field: ErrorField, volume: WorkVolume) -> int:
    """Count the nodes, ends and middles that `error_extremes` has to look at."""
    degrees = [degree_along(field, axis) for axis in LINEAR_LETTERS]
    return math.prod(c.size for c in _coordinates(field, volume, degrees)[0])


def ends_of_pieces(field: ErrorField, axis: str, ends_mm: tuple[float, float]) -> FloatArray:
    """Give the nodes of an axis' tables inside a range, and its ends.

    Returns
    -------
    ndarray, shape (k,) [mm]
        Increasing; one where the range is a point.
    """
    nodes = field.nodes_mm(axis)
    inside = nodes[(nodes > ends_mm[0]) & (nodes < ends_mm[1])]
    return np.unique(np.concatenate([ends_mm, inside]))
