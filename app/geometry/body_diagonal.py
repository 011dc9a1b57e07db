"""The four body diagonals of a work volume, and what they say of it (8.108–8.111, ISO 230-6).

A diagonal's three letters say in which direction each axis runs, p up and n down: npp
runs from (x_max, y_min, z_min) to (x_min, y_max, z_max). Its displacement is the error
along the diagonal's unit vector r since the start, in µm; positive where the machine
went too far.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray
from app.errors import InvalidContent, list_names
from app.geometry.components import LINEAR_LETTERS
from app.geometry.error_field import ErrorField
from app.geometry.volumetric_error import NO_TOOL
from app.geometry.work_volume import WorkVolume

DIAGONALS: Final = ("ppp", "npp", "pnp", "ppn")
"""The chapter's four; each run backwards is nnn, pnn, npn, nnp."""


@dataclass(frozen=True, slots=True)
class DiagonalAccuracy:
    """How far the displacements on the body diagonals spread.

    Parameters
    ----------
    ranges_um
        Diagonal to the largest less the smallest displacement on it [µm] (8.130–8.133;
        the labels of 8.132 and 8.133 are misprinted).
    ed_um
        Ed, the largest of these ranges [µm].
    esd_um
        ESd, the largest less the smallest displacement of all diagonals together [µm].
    """

    ranges_um: Mapping[str, float]
    ed_um: float
    esd_um: float


def diagonal_ends(volume: WorkVolume, diagonal: str) -> tuple[FloatArray, FloatArray]:
    """Find where a body diagonal begins and ends.

    Parameters
    ----------
    diagonal
        `ppp`, `npp`, `pnp` or `ppn`.

    Returns
    -------
    start, end : ndarray, shape (3,) [mm]

    Examples
    --------
    >>> box = WorkVolume((0.0, 3.0), (0.0, 4.0), (0.0, 12.0))
    >>> start, end = diagonal_ends(box, "npp")
    >>> start.tolist(), end.tolist()
    ([3.0, 0.0, 0.0], [0.0, 4.0, 12.0])
    """
    if diagonal not in DIAGONALS:
        raise InvalidContent.of_field(
            "diagonals", f"expected {list_names(DIAGONALS)}, got {diagonal!r}"
        )
    ranges = zip(diagonal, volume.ranges_mm, strict=True)
    ends = np.array([(low, high) if way == "p" else (high, low) for way, (low, high) in ranges])
    return ends[:, 0], ends[:, 1]


def extreme_displacements(
    field: ErrorField, volume: WorkVolume, tool_offset_mm: ArrayLike = NO_TOOL
) -> dict[str, FloatArray]:
    """Say what a laser would read wherever a model's displacement can have an extreme.

    Parameters
    ----------
    tool_offset_mm : array-like, shape (3,) [mm]
        Tool offset T of the reflector.

    Returns
    -------
    dict of diagonal to ndarray, shape (n,) [µm]
        Displacement since the start, the first 0: at the start, the tables' nodes, the
        end, and where the slope between them is 0. Its least and largest are the true
        ones.

    Notes
    -----
    On a diagonal every coordinate is a straight line of the share t of the way. Between
    nodes an error is one too, so that it is of degree 2 times a lever arm or, as a
    slope, times a coordinate, and of degree 3 where a slope of a rotation is multiplied
    by both. Four values at t = 0, ⅓, ⅔, 1 of each piece are its cubic exactly, and the
    roots of its derivative, a quadratic, are where it can turn.

    Examples
    --------
    A yaw that falls with x and has x as its arm moves y by −20 µm/m² x².

    >>> from app.geometry.chain import Chain
    >>> from app.geometry.error_table import Table
    >>> tables = {"ECX": Table([-500.0, 500.0], [10.0, -10.0])}
    >>> field = ErrorField.make(Chain.parse("XYFZ"), tables)
    >>> box = WorkVolume((-500.0, 500.0), (-500.0, 500.0), (0.0, 0.0))
    >>> read = extreme_displacements(field, box)["pnp"]
    >>> float(read.min().round(3)), float(read.max().round(3))
    (-3.536, 0.0)
    """
    field.expect_one_state()
    if not volume.diagonal_mm > 0:
        raise InvalidContent.of_field("volume", "expected a diagonal longer than 0 mm, got 0 mm")
    displacements = {}
    for diagonal in DIAGONALS:
        start, end = diagonal_ends(volume, diagonal)
        ends = _ends_of_pieces(field, start, end)
        # Along a diagonal all coordinates are linear in the share of the way. Between nodes a
        # rotation's table, its slope's coordinate and its lever arm are linear each: their product
        # is a cubic, which four values determine.
        thirds = (ends[:-1, None] + np.diff(ends)[:, None] * [0, 1 / 3, 2 / 3, 1]).ravel()
        errors_um, _ = field.at(start + thirds[:, None] * (end - start), tool_offset_mm)
        along = displacement_along(errors_um, end - start).reshape(-1, 4)
        inside = _turns_of_cubics(along)
        turns = ends[:-1, None] + np.diff(ends)[:, None] * inside
        shares = np.concatenate([ends, turns[np.isfinite(turns)]])
        # In order along the way: displacements count from the first point, which has to be the
        # start.
        errors_um, _ = field.at(start + np.sort(shares)[:, None] * (end - start), tool_offset_mm)
        displacements[diagonal] = displacement_along(errors_um, end - start)
    return displacements


def _ends_of_pieces(field: ErrorField, start: FloatArray, end: FloatArray) -> FloatArray:
    """Give the shares of a diagonal at which one of the tables has a node, and 0 and 1."""
    cuts = [np.array([0.0, 1.0])]
    for axis, from_mm, to_mm in zip(LINEAR_LETTERS, start, end, strict=True):
        if from_mm != to_mm:
            shares = (field.nodes_mm(axis) - from_mm) / (to_mm - from_mm)
            cuts.append(shares[(shares > 0.0) & (shares < 1.0)])
    return np.unique(np.concatenate(cuts))


def _turns_of_cubics(values: FloatArray) -> FloatArray:
    """Find where in (0, 1) cubics turn that have these values at 0, ⅓, ⅔ and 1.

    Parameters
    ----------
    values : ndarray, shape (n, 4)

    Returns
    -------
    ndarray, shape (n, 2)
        NaN where there is no such place.
    """
    v0, v1, v2, v3 = values.T
    # d/dt of the cubic through them: linear + 2 quadratic t + 3 cubic t².
    linear = (-11 * v0 + 18 * v1 - 9 * v2 + 2 * v3) / 2
    quadratic = 9 * (2 * v0 - 5 * v1 + 4 * v2 - v3) / 2
    cubic = 9 * (-v0 + 3 * v1 - 3 * v2 + v3) / 2
    # Neither root is a difference of nearly equal numbers, however small the cubic's share.
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(quadratic**2 - 3 * cubic * linear)
        # The roots' product is linear/(3 cubic), so the second one is linear/q. A cubic's share of
        # 0 makes the first infinite, which is none, and the second the parabola's −linear/(2
        # quadratic).
        q = -(quadratic + np.copysign(root, quadratic))
        turns = np.stack([q / (3 * cubic), linear / q], axis=1)
    return np.where((turns > 0.0) & (turns < 1.0), turns, np.nan)


def displacement_along(errors_um: FloatArray, direction: FloatArray) -> FloatArray:
    """Project errors on a direction, counted from the first point.

    Parameters
    ----------
    errors_um : ndarray, shape (n, 3) [µm]
        Errors at points along a line.
    direction : ndarray, shape (3,)
        The line's direction, of any length.

    Returns
    -------
    ndarray, shape (n,) [µm]
    """
    along: FloatArray = (errors_um - errors_um[0]) @ (direction / np.linalg.norm(direction))
    return along


def diagonal_accuracy(displacements_um: Mapping[str, ArrayLike]) -> DiagonalAccuracy:
    """Compute Ed and ESd from the displacements on the body diagonals.

    Parameters
    ----------
    displacements_um : mapping of diagonal to array-like, shape (n,) [µm]
        Measured, or of a model; each counted from its start.

    Raises
    ------
    InvalidContent
        If one of the four diagonals is missing, empty or not finite.

    Notes
    -----
    (8.130–8.133) and the two lines below them. A squareness error alone makes two
    diagonals longer and two shorter by the same amount, so that it enters Ed once and
    ESd twice; the chapter's "does not include squareness errors" of Ed means the
    difference between diagonals.

    Examples
    --------
    >>> found = diagonal_accuracy({"ppp": [0, 3], "npp": [0, -2], "pnp": [0, 1], "ppn": [0, 1]})
    >>> found.ed_um, found.esd_um
    (3.0, 5.0)
    """
    arrays = {
        name: np.asarray(values, dtype=np.float64) for name, values in displacements_um.items()
    }
    for name in DIAGONALS:
        values = arrays.get(name, np.empty(0))
        if not values.size or not np.isfinite(values).all():
            raise InvalidContent.of_field(
                f"diagonals.{name}", "expected finite displacements in µm, got none or others"
            )
    ranges = {name: float(np.ptp(arrays[name])) for name in DIAGONALS}
    everything = np.concatenate([arrays[name].ravel() for name in DIAGONALS])
    return DiagonalAccuracy(ranges, max(ranges.values()), float(np.ptp(everything)))
