"""Location errors of rotary axes and what they do to a point that the axes carry.

T.-H. Hsieh et al., Geometric error compensation method using the Laser R-test (2024),
[R]: a rotary axis stands beside and askew to where it should be. Its four errors do not
depend on the angle, but their effect does. [R] gives them for a C axis and an A axis;
x → y → z → x turns the one into the other, and A into B: one rule serves all three.

Sign: error = actual minus nominal position, in the machine's directions, of a point
that the rotary axes carry (the ball on the table, [R] 12, 25; the tool on a swivelling
head). Where the axes carry the workpiece, the tool's error relative to it is minus
this. Angles are positive by the right-hand rule about the axis' positive direction:
[R] 9–13 and 22–25, while [R] 14–16 and 26–28 as printed are for −θ.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray
from app.errors import InvalidContent, list_names
from app.geometry.components import (
    COMPONENTS,
    LINEAR_LETTERS,
    ROTARY_LOCATION_CODES,
    ROTATION_LETTERS,
    Kind,
)
from app.geometry.error_table import bounded
from app.geometry.volumetric_error import as_points
from app.units import UM_PER_MM, URAD_PER_RAD

AXIS_LETTERS: Final = ROTATION_LETTERS
"""The rotary axes: A turns about x, B about y, C about z."""


@dataclass(frozen=True, slots=True, eq=False)
class RotaryAxis:
    """A rotary axis as it is: one line in space, or one for each of n states.

    Parameters
    ----------
    point_mm : ndarray, shape (3,) or (n, 3) [mm]
        A point of the axis: where it crosses x = 0 (A), y = 0 (B) or z = 0 (C).
    direction : ndarray, shape (3,) or (n, 3)
        Unit vector.
    """

    point_mm: FloatArray
    direction: FloatArray

    def turn(self, points_mm: FloatArray, angle_rad: FloatArray) -> FloatArray:
        """Turn points about the axis (Rodrigues; [R] 9, 22).

        Parameters
        ----------
        points_mm : ndarray, shape (n, 3) [mm]
            Points before the turn.
        angle_rad : ndarray, shape (n,) [rad]
            Angles, positive by the right-hand rule.

        Returns
        -------
        ndarray, shape (n, 3) [mm]
            Points after it.
        """
        arm = points_mm - self.point_mm
        cos, sin = np.cos(angle_rad)[:, None], np.sin(angle_rad)[:, None]
        # cos θ v + sin θ k × v + (1 − cos θ) (k · v) k: the matrices [R] 9 and 22. In [R] 11 as
        # printed the last element has − cos θ and the one before it − k_x sin θ; (9) has both
        # right.
        along = (arm * self.direction).sum(axis=1, keepdims=True) * self.direction
        turned: FloatArray = cos * arm + sin * np.cross(self.direction, arm) + (1 - cos) * along
        return self.point_mm + turned


def about(letter: str) -> int:
    """Give the number of the coordinate about which a rotary axis turns.

    >>> about("c")
    2
    """
    return AXIS_LETTERS.index(letter.lower())


def cyclic_codes(letter: str) -> tuple[str, str, str, str]:
    """Name a rotary axis' errors in cyclic order: the two coordinates after its own.

    Returns
    -------
    first, second, tilt, other
        Position in the first and in the second coordinate, rotation about the first and
        about the second.

    Examples
    --------
    >>> cyclic_codes("c"), cyclic_codes("b")
    (('XOC', 'YOC', 'AOC', 'BOC'), ('ZOB', 'XOB', 'COB', 'AOB'))
    """
    first, second = ((about(letter) + step) % 3 for step in (1, 2))
    places = (LINEAR_LETTERS[first], LINEAR_LETTERS[second])
    turns = (AXIS_LETTERS[first], AXIS_LETTERS[second])
    first_place, two, tilt, other = (f"{way}o{letter}".upper() for way in (*places, *turns))
    return first_place, two, tilt, other


def actual_axis(
    letter: str, errors: Mapping[str, ArrayLike], pivot_mm: ArrayLike = (0.0, 0.0, 0.0)
) -> RotaryAxis:
    """Place a rotary axis where its location errors put it.

    Parameters
    ----------
    errors
        Component code to value [µm for XOC, YOC, YOA, ZOA, XOB, ZOB; µrad for AOC, BOC,
        BOA, COA, AOB, COB], or to an array of shape (n,); those left out count as zero.
    pivot_mm : array-like, shape (3,) [mm]
        A point of the nominal axis.

    Notes
    -----
    Directions are the exact ones of [R] 8, (cos A sin B, −sin A, cos A cos B), of [R] 21,
    (cos B cos C, cos B sin C, −sin B), and in the same cyclic order of a B axis,
    (−sin C, cos C cos A, cos C sin A).

    Examples
    --------
    >>> actual_axis("c", {"XOC": -0.5, "YOC": 21.5}).point_mm.tolist()
    [-0.0005, 0.0215, 0.0]
    """
    if letter not in AXIS_LETTERS:
        raise InvalidContent.of_field(
            "order", f"expected rotary axes among A, B and C, got {letter!r}"
        )
    first, second, tilt, other = (
        np.asarray(errors.get(code, 0.0), dtype=np.float64) for code in cyclic_codes(letter)
    )
    tilt, other = tilt / URAD_PER_RAD, other / URAD_PER_RAD
    # In cyclic order (first, second, along) all three axes are alike. The direction is the third
    # column of E_second · E_first, first the tilt about the first coordinate, then about the
    # second:
    #     C: E_BOC E_AOC k, [R] 7 and 8          A: E_COA E_BOA i, [R] 20 and 21
    # As to position, an axis has two coordinates: it is where it crosses 0 of the third.
    pivot = np.roll(np.asarray(pivot_mm, dtype=np.float64), -about(letter) - 1)
    point = _columns(pivot[0] + first / UM_PER_MM, pivot[1] + second / UM_PER_MM, 0.0)
    direction = _columns(np.cos(tilt) * np.sin(other), -np.sin(tilt), np.cos(tilt) * np.cos(other))
    # So far (first, second, along); back to (x, y, z).
    back = about(letter) + 1
    return RotaryAxis(np.roll(point, back, axis=-1), np.roll(direction, back, axis=-1))


def location_codes(order: str) -> list[str]:
    """List the location errors of rotary axes.

    Parameters
    ----------
    order
        The axes from the base outward: `AC`, `BC`, `B` and so on.

    Returns
    -------
    list of str
        Component codes, in the order of the table of components for each axis.

    Raises
    ------
    InvalidContent
        If the order names another axis than A, B and C, one twice, or none.

    Examples
    --------
    >>> location_codes("C")
    ['XOC', 'YOC', 'AOC', 'BOC']
    >>> location_codes("B")
    ['XOB', 'ZOB', 'AOB', 'COB']
    """
    return [
        code
        for letter in _checked_order(order)
        for code in ROTARY_LOCATION_CODES
        if code.endswith(letter.upper())
    ]


def rotary_location_error(
    errors: Mapping[str, ArrayLike],
    points_mm: ArrayLike,
    angles_deg: Mapping[str, ArrayLike],
    order: str = "AC",
    pivots_mm: Mapping[str, ArrayLike] | None = None,
) -> FloatArray:
    """Say how far a carried point is from where it should be at given angles.

    Parameters
    ----------
    errors
        Code of a location error to its value [µm or µrad], or to an array of shape
        (n,); those left out count as zero.
    points_mm : array-like, shape (3,) or (n, 3) [mm]
        The point (ball, workpiece or tool) with all rotary axes at 0, in coordinates
        along the machine's directions in which the base of the rotary axes stands still
        (on a swivelling head: coordinates that travel with the head).
    angles_deg
        Rotary axis (`a`, `b`, `c`) to its angle, or to an array of shape (n,) [°]; axes left
        out stand at 0.
    order
        Rotary axes from the base outward: in `AC` the A axis carries the C axis, as in
        a tilting rotary table; `C` alone for one axis.
    pivots_mm
        Rotary axis to a point of its nominal line [mm], of which the coordinate along the
        axis does not matter; the origin where left out.

    Returns
    -------
    ndarray, shape (n, 3) [µm]
        Actual minus nominal position of the carried point, exact in the errors; 0 where
        all angles are 0.

    Raises
    ------
    InvalidContent
        If an axis is not A, B or C, or a component is no location error.

    Notes
    -----
    The errors are those at angle 0 of all axes: an axis that is carried moves with the
    one that carries it. In [R] 11 the last element is to be k_z k_z vθ + cθ and the one
    before it k_y k_z vθ + k_x sθ, as in [R] 9.

    Examples
    --------
    An axis 1 µm too far in x throws a point at C = 180° by 2 µm.

    >>> error_um = rotary_location_error({"XOC": 1.0}, [100.0, 0.0, 50.0], {"c": 180.0}, "C")
    >>> np.allclose(error_um, [[2.0, 0.0, 0.0]])
    True
    """
    carriers = _checked_order(order)
    _check_belonging(order, angles_deg, errors)
    pivots = {letter.lower(): pivot for letter, pivot in (pivots_mm or {}).items()}
    angles = {letter.lower(): np.asarray(angle, float) for letter, angle in angles_deg.items()}
    points = bounded("points_mm", as_points(points_mm))
    _check_angles(angles, len(points))
    shapes = [points[:, 0], *angles.values(), *(np.asarray(v, float) for v in errors.values())]
    n = np.broadcast(*shapes).size
    actual = nominal = np.broadcast_to(points, (n, 3))
    # The outermost axis turns first: it is carried by those before it.
    for letter in reversed(carriers):
        angle = np.broadcast_to(np.deg2rad(angles.get(letter, np.zeros(()))), (n,))
        pivot = pivots.get(letter, np.zeros(3))
        actual = actual_axis(letter, errors, pivot).turn(actual, angle)
        # Both by the same formula: what is rounded is rounded alike, and at angle 0 the error is
        # exactly 0.
        nominal = actual_axis(letter, {}, pivot).turn(nominal, angle)
    error_um: FloatArray = (actual - nominal) * UM_PER_MM
    return error_um


def _checked_order(order: str) -> str:
    carriers = order.lower()
    unknown = [letter for letter in carriers if letter not in AXIS_LETTERS]
    if unknown or not carriers or len(set(carriers)) != len(carriers):
        raise InvalidContent.of_field(
            "order",
            f"expected the rotary axes A, B, C from the base outward, such as AC, BC or B, got "
            f"{order!r}",
        )
    return carriers


def _check_angles(angles_deg: Mapping[str, FloatArray], points: int) -> None:
    sizes = {angle.size for angle in angles_deg.values()}
    n = max(points, *sizes, 1)
    for letter, angle in angles_deg.items():
        field = f"angles_deg.{letter.upper()}"
        if not np.isfinite(angle).all():
            raise InvalidContent.of_field(field, "expected finite angles in °, got NaN or infinity")
        if angle.ndim > 1 or angle.size not in (1, n) or points not in (1, n):
            raise InvalidContent.of_field(
                field,
                f"expected one angle in ° or one for each of {points if points > 1 else n} points "
                f"or angles, got {angle.size}",
            )


def _check_belonging(
    order: str, angles_deg: Mapping[str, ArrayLike], errors: Mapping[str, ArrayLike]
) -> None:
    carriers = order.lower()
    absent = [letter for letter in angles_deg if letter.lower() not in carriers]
    if absent:
        raise InvalidContent.of_field(
            "angles_deg", f"expected angles in ° of {order}, got {list_names(absent)}"
        )
    for code in errors:
        if code not in COMPONENTS or COMPONENTS[code].kind is not Kind.ROTARY_LOCATION:
            raise InvalidContent.of_field(
                "errors",
                f"expected location errors ({list_names(ROTARY_LOCATION_CODES)}), got {code!r}",
            )


def _columns(x: ArrayLike, y: ArrayLike, z: ArrayLike) -> FloatArray:
    """Put three coordinates side by side: shape (3,) or (n, 3)."""
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1).astype(np.float64)
