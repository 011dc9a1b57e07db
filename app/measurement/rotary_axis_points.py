"""Points of an R-test, checked: whether they can have come from a turn, and show an axis."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray, rms
from app.errors import InvalidContent
from app.measurement.axis_of_rotation import AxisFit, fit_axis, fit_position
from app.measurement.stated_numbers import (
    FARTHEST_MM,
    as_array,
    as_numbers,
    expect_plausible,
)
from app.units import UM_PER_MM, URAD_PER_RAD

NEAREST_MM: Final = 1.0
"""A ball so near to its axis shows no direction, or its places are in metres."""

SAME_ANGLE_DEG: Final = 0.1
STRAIGHT: Final = 1e-3
"""How far places on a line may be beside it, as a share of its length: half a degree of arc."""

LARGEST_MISFIT_MM: Final = 1.0
LARGEST_TILT_RAD: Final = 0.1
WORST_POSITION_PER_UM: Final = 30.0
"""How many µm 1 µm of noise may move the axis at the ball: 180° give 0.6, 40° 2, 3° 30."""

WORST_TILT_URAD_PER_UM: Final = 1000.0
"""How far 1 µm of noise may tilt it; at a radius of 100 mm 180° give 12, 80° 50, 18° 1000.

Beyond, the direction is not told from noise, and the nominal one is taken."""

_FITS: Final = 0.1
"""Share of the largest misfit and tilt, below which other angles or axes explain them."""

_AFTER: Final = {"c": "a", "a": "b", "b": "c"}
"""The axis that is the case at hand when the coordinates move one place to the front."""


def checked_points(angle_deg: ArrayLike, position_mm: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Take angles and places of a ball as arrays.

    Parameters
    ----------
    angle_deg : array-like, shape (n,) [°]
    position_mm : array-like, shape (n, 3) [mm]

    Returns
    -------
    angles, points : ndarray, shapes (n,) [°] and (n, 3) [mm]

    Raises
    ------
    InvalidContent
        If their numbers differ, or something is not finite or beyond 100 m.
    """
    angles = as_numbers("points.angle_deg", angle_deg, "°")
    points = as_array("points.position_mm", position_mm, "numbers in mm, as many for every point")
    if angles.ndim != 1 or points.shape != (angles.size, 3):
        raise InvalidContent.of_field(
            "points",
            "expected an angle in ° and x, y, z in mm of every point, got arrays of shape "
            f"{angles.shape} and {points.shape}",
        )
    expect_plausible("points.position_mm", points, "mm", FARTHEST_MM, "perhaps in µm", place=_place)
    return angles, points


def number_places(angles_deg: FloatArray) -> FloatArray:
    """Number the different angles; those within SAME_ANGLE_DEG are repeats of one.

    Parameters
    ----------
    angles_deg : ndarray, shape (n,) [°]
        Angles; whole turns do not count.

    Returns
    -------
    ndarray, shape (n,)
        From 0, in order of angle.

    Raises
    ------
    InvalidContent
        If there are fewer than two different angles.

    Examples
    --------
    >>> number_places(np.array([0.0, 180.0, 359.99, 90.0])).tolist()
    [0.0, 2.0, 0.0, 1.0]
    """
    turned = angles_deg % 360.0
    numbers = np.zeros(turned.size)
    first, number = -math.inf, -1
    for i in np.argsort(turned, kind="stable"):
        # From the first angle of a place, not from the one before: small gaps would else chain
        # different angles into one place.
        if turned[i] - first > SAME_ANGLE_DEG:
            first, number = turned[i], number + 1
        numbers[i] = number
    # Just below a full turn and 0 are the same place.
    if turned.size and turned.min() + 360.0 - first <= SAME_ANGLE_DEG:
        numbers[numbers == number] = 0.0
    if np.unique(numbers).size < 2:
        raise InvalidContent.of_field(
            "points",
            f"expected points at 2 angles or more, at least {SAME_ANGLE_DEG:g}° apart within a "
            f"turn, got {turned.size} at {np.unique(numbers).size}",
        )
    return numbers


def checked_fit(
    letter: str, points_mm: FloatArray, angles_rad: FloatArray, places: FloatArray
) -> AxisFit:
    """Fit the axis, and refuse what cannot be one or would be no more than noise.

    Parameters
    ----------
    letter
        `a`, `b` or `c`.
    points_mm : ndarray, shape (n, 3) [mm]
        Places of the ball: first, second, and the coordinate along the nominal axis.
    angles_rad : ndarray, shape (n,) [rad]
    places : ndarray, shape (n,)
        Number of the angle that each point repeats.

    Returns
    -------
    AxisFit
        Without direction where there are only two different angles, or where 1 µm of noise
        would tilt the axis by more than a milliradian.

    Raises
    ------
    InvalidContent
        If the places do not belong to the angles, or lie on too short an arc.
    """
    _check_extent(points_mm, places)
    fit = _fit(points_mm, angles_rad, places)
    if _excess(fit, points_mm) > 1.0:
        raise InvalidContent.of_field(
            "points",
            f"expected places of a ball that a {letter.upper()} axis turned by the stated "
            f"angles, within {LARGEST_MISFIT_MM:g} mm and {LARGEST_TILT_RAD:g} rad of tilt, "
            f"got {_misfit_mm(fit, points_mm):.3g} mm (rms) beside such an arc and "
            f"{_tilt_rad(fit, points_mm):.3g} rad{_perhaps(letter, points_mm, angles_rad, places)}",
        )
    if fit.radius_mm < NEAREST_MM:
        raise InvalidContent.of_field(
            "points.position_mm",
            f"expected a ball at least {NEAREST_MM:g} mm beside the axis, got "
            f"{fit.radius_mm:.3g} mm: perhaps in m",
        )
    _check_arc(fit, angles_rad)
    return fit


def position_per_um(fit: AxisFit) -> float:
    """Say by how many µm 1 µm of noise moves the axis at the ball, where it moves it most."""
    return float(np.sqrt(np.linalg.eigvalsh(fit.cofactor[:2, :2])[-1]))


def urad_per_um(fit: AxisFit) -> float | None:
    """Say by how many µrad 1 µm of noise tilts the axis, where it tilts it most.

    Returns
    -------
    float or None
        None where the direction was not fitted.
    """
    if len(fit.cofactor) == 2:
        return None
    largest = np.sqrt(np.linalg.eigvalsh(fit.cofactor[2:, 2:])[-1])
    return float(largest * URAD_PER_RAD / UM_PER_MM)


def arc_deg(angles_rad: FloatArray) -> float:
    """Give the shortest arc that holds all angles.

    Parameters
    ----------
    angles_rad : ndarray, shape (n,) [rad]

    Returns
    -------
    float [°]

    Examples
    --------
    >>> round(arc_deg(np.deg2rad([350.0, 0.0, 40.0])), 9)
    50.0
    """
    turned = np.sort(np.rad2deg(angles_rad) % 360.0)
    return float(360.0 - np.diff(np.append(turned, turned[0] + 360.0)).max())


def _place(at: list[int]) -> str:
    return f"at index {at}"


def _check_extent(points_mm: FloatArray, places: FloatArray) -> None:
    """Refuse places that are one place, or one straight line."""
    extent = np.ptp(points_mm, axis=0).max()
    if extent < NEAREST_MM:
        raise InvalidContent.of_field(
            "points.position_mm",
            f"expected places of a ball beside the axis, more than {NEAREST_MM:g} mm apart, "
            f"got {extent:.3g} mm: the ball stands on the axis, or positions are in m",
        )
    if np.unique(places).size < 3:
        return
    sizes = np.linalg.svd(points_mm - points_mm.mean(axis=0), compute_uv=False)
    if sizes[1] < STRAIGHT * sizes[0]:
        raise InvalidContent.of_field(
            "points.position_mm",
            "expected places on an arc, got places on a straight line, to "
            f"{sizes[1] / sizes[0]:.1g} of its length: nothing in them shows the axis",
        )


def _fit(points_mm: FloatArray, angles_rad: FloatArray, places: FloatArray) -> AxisFit:
    if np.unique(places).size > 2:
        fit = fit_axis(points_mm, angles_rad)
        if (urad_per_um(fit) or 0.0) <= WORST_TILT_URAD_PER_UM:
            return fit
    return fit_position(points_mm, angles_rad, places)


def _misfit_mm(fit: AxisFit, points_mm: FloatArray) -> float:
    return rms(points_mm - fit.fitted_mm)


def _tilt_rad(fit: AxisFit, points_mm: FloatArray) -> float:
    """Size of the tilt, or how steeply the ball climbs between two angles."""
    if len(fit.cofactor) > 2:
        return float(np.hypot(*fit.tilts_rad))
    across, climb = np.hypot(*np.ptp(points_mm[:, :2], axis=0)), np.ptp(points_mm[:, 2])
    return float(np.arctan2(climb, across))


def _excess(fit: AxisFit, points_mm: FloatArray) -> float:
    """Say how many times misfit or tilt is what it may be."""
    return max(
        _misfit_mm(fit, points_mm) / LARGEST_MISFIT_MM, _tilt_rad(fit, points_mm) / LARGEST_TILT_RAD
    )


def _perhaps(letter: str, points_mm: FloatArray, angles_rad: FloatArray, places: FloatArray) -> str:
    """Find what else the numbers may be, so that they fit."""
    forward, backward = (np.roll(points_mm, shift, axis=1) for shift in (-1, 1))
    following, previous = _AFTER[letter], _AFTER[_AFTER[letter]]
    others = [
        ("the angles run the other way (positive by the right-hand rule)", points_mm, -angles_rad),
        # Taken for degrees they were turned into radians once too often.
        ("the angles are in rad", points_mm, np.rad2deg(angles_rad)),
        (f"it is the {following.upper()} axis", forward, angles_rad),
        (f"it is the {previous.upper()} axis", backward, angles_rad),
    ]
    for what, points, turn in others:
        if _excess(_fit(points, turn, places), points) < _FITS:
            return f"; perhaps {what}"
    return ""


def _check_arc(fit: AxisFit, angles_rad: FloatArray) -> None:
    """Refuse an arc on which a micrometre of noise is more than the axis' errors."""
    position = position_per_um(fit)
    if position > WORST_POSITION_PER_UM:
        raise InvalidContent.of_field(
            "points.angle_deg",
            f"expected a longer arc, got points over {arc_deg(angles_rad):.3g}° at a radius of "
            f"{fit.radius_mm:.3g} mm: 1 µm of noise would move the axis by {position:.0f} µm",
        )
