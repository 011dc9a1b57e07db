"""R-test of a rotary axis: where a carried ball was at known angles tells how the axis lies.

T.-H. Hsieh et al., Geometric error compensation method using the Laser R-test (2024), [R].
The axis of rotation is fitted by least squares with the exact motion of Rodrigues ([R] 9,
22), not by solving [R] 14–16 for two or three points, which are printed for −θ. Angles are
positive by the right-hand rule; errors have the signs of `app.geometry.rotary_axes`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from app.answer import AS_IT_IS, Answer
from app.arrays import FloatArray, frozen, largest_length, rms_length
from app.errors import InvalidContent
from app.geometry.components import COMPONENTS
from app.geometry.rotary_axes import (
    AXIS_LETTERS,
    RotaryAxis,
    about,
    actual_axis,
)
from app.measurement.result import Evaluated, MeasurementResult
from app.measurement.rotary_axis_points import checked_fit, checked_points, number_places
from app.measurement.rotary_axis_report import (
    CODES,
    FittedPoints,
    figures_of,
    notes_on,
)
from app.measurement.stated_numbers import as_point, as_standard_deviation
from app.rounding import Digits, listed
from app.thermal.error_map import VALUE_LIMIT, ComponentTable
from app.units import UM_PER_MM, URAD_PER_RAD

_FRONT: Final = {letter: (about(letter) + 1) % 3 for letter in AXIS_LETTERS}
"""How many coordinates go to the end: (x, y, z) for C, (y, z, x) for A, (z, x, y) for B."""


@dataclass(frozen=True, slots=True, eq=False)
class PathErrors(Answer, published_as="PathErrorsAnswer"):
    """How far the ball was beside the spindle that follows it, point by point."""

    # [R] 4.2: the control turns the ball's place at angle 0, by the fit, about the axis as it knows
    # it. Shapes (n, 3). The second as two of [R]'s points give it.
    before_um: Annotated[FloatArray, listed(2)]
    """Following the nominal axis: x, y, z, measured minus followed place [µm]"""
    position_um: Annotated[FloatArray, listed(2), Field(alias="after_position_um")]
    """Following an axis of nominal direction through the actual axis' place at the ball: its two
    position errors compensated [µm]"""
    all_um: Annotated[FloatArray, listed(2), Field(alias="after_all_um")]
    """Following the axis that was found: all its errors compensated [µm]. At the points that showed
    them; at others it may be more"""

    def figures(self) -> dict[str, float]:
        """Sum up the lengths of each [µm]."""
        stages = {
            "before": self.before_um,
            "after_position": self.position_um,
            "after_all": self.all_um,
        }
        return {
            f"path_{name}_{stage}_um": of(vectors)
            for stage, vectors in stages.items()
            for name, of in (("rms", rms_length), ("max", largest_length))
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class RotaryAxisMeasurement(Evaluated):
    """The axis' location errors, with run-out in `figures`."""

    # `a`, `b` or `c`; the axis as a line in the coordinates of the points; the ball at angle 0 by
    # the fit, and a point of the nominal axis, shape (3,) [mm].
    letter: Annotated[str, Field(exclude=True)]
    axis: Annotated[RotaryAxis, AS_IT_IS, Field(exclude=True)]
    start_mm: Annotated[FloatArray, AS_IT_IS, Field(exclude=True)]
    pivot_mm: Annotated[FloatArray, AS_IT_IS, Field(exclude=True)]
    # Component code to value [µm, µrad], without the two tilts where the points do not show them;
    # their covariance together, in their order, shape (k, k) [µm², µm·µrad, µrad²].
    errors: Annotated[Mapping[str, float], Field(exclude=True)]
    covariance: Annotated[FloatArray | None, AS_IT_IS, Field(exclude=True)]
    residuals_um: Annotated[FloatArray, listed(2)]
    """Measured minus fitted place of the ball: radial (outward), tangential (in the sense of
    positive rotation), axial [µm]"""
    noise_um: Digits | None
    """Standard deviation of one coordinate, from the residuals or as stated [µm]"""
    degrees_of_freedom: int
    """Of that noise; 0 where it was stated or nobody knows"""
    path: PathErrors
    """The path errors before and after compensation; rms and largest length are in `figures`
    [µm]"""


def measure_rotary_axis(
    axis: str,
    angle_deg: ArrayLike,
    position_mm: ArrayLike,
    *,
    repeatability_um: float | None = None,
    pivot_mm: ArrayLike = (0.0, 0.0, 0.0),
) -> RotaryAxisMeasurement:
    """Find how a rotary axis lies from the places of a ball that it carries.

    Parameters
    ----------
    axis
        `A`, `B` or `C`.
    angle_deg : array-like, shape (n,) [°]
        Angle of the rotary axis at each point, positive by the right-hand rule; repeats
        are welcome.
    position_mm : array-like, shape (n, 3) [mm]
        The ball's x, y, z there, in the machine's directions.
    repeatability_um
        Standard deviation of one coordinate [µm], used where the points have no
        redundancy of their own.
    pivot_mm : array-like, shape (3,) [mm]
        A point of the nominal axis; its coordinate along the axis does not matter.

    Returns
    -------
    RotaryAxisMeasurement
        XOC, YOC, AOC, BOC, or YOA, ZOA, BOA, COA, or ZOB, XOB, COB, AOB: the position is
        where the axis crosses z = 0 (C), x = 0 (A) or y = 0 (B) of the given coordinates,
        less the pivot's. From two
        different angles, or three of which two are almost the same, only the position, as
        if the direction were the nominal one.

    Raises
    ------
    InvalidContent
        If there is no such axis, if there are fewer than two different angles, or if the
        points cannot have come from such a turn or lie on too short an arc.

    Notes
    -----
    [R] solves two points for the position and three for the direction; here all points
    count alike. n points have 3n coordinates and 7 unknowns; from two different angles 6
    (four in the plane of rotation and the ball's height at both angles).

    Examples
    --------
    Half a turn moves the ball from x = 101 to −99 mm: the axis is at x = 1, y = 2 mm.

    >>> found = measure_rotary_axis("C", [0, 180], [[101, 2, 50], [-99, 2, 50]])
    >>> {code: round(error, 6) for code, error in found.errors.items()}
    {'XOC': 1000.0, 'YOC': 2000.0}
    """
    letter = _checked_axis(axis)
    angles_deg, points = checked_points(angle_deg, position_mm)
    pivot = frozen(as_point("pivot_mm", pivot_mm, math.inf))
    repeatability = as_standard_deviation("repeatability_um", repeatability_um, "µm")
    rolled, angles = np.roll(points, -_FRONT[letter], axis=1), np.deg2rad(angles_deg)
    fit = checked_fit(letter, rolled, angles, number_places(angles_deg))
    return _measurement(FittedPoints(letter, fit, rolled, angles, repeatability), pivot)


def _measurement(fitted: FittedPoints, pivot_mm: FloatArray) -> RotaryAxisMeasurement:
    crossing, cofactor = fitted.fit.at_height_0()
    errors = _errors(fitted, crossing, pivot_mm)
    covariance = fitted.covariance_of(cofactor)
    path = _path_errors(fitted, errors, pivot_mm)
    return RotaryAxisMeasurement(
        letter=fitted.letter,
        axis=actual_axis(fitted.letter, errors, pivot_mm),
        start_mm=frozen(np.roll(fitted.fit.start_mm, _FRONT[fitted.letter])),
        pivot_mm=pivot_mm,
        errors=errors,
        covariance=covariance,
        residuals_um=fitted.residuals_um(),
        noise_um=fitted.noise_um,
        degrees_of_freedom=fitted.degrees_of_freedom,
        path=path,
        result=MeasurementResult(
            _tables(errors, covariance),
            figures_of(fitted) | path.figures(),
            notes_on(fitted, errors),
        ),
    )


def _path_errors(
    fitted: FittedPoints, errors: Mapping[str, float], pivot_mm: FloatArray
) -> PathErrors:
    front = _FRONT[fitted.letter]
    measured_mm = np.roll(fitted.points_mm, front, axis=1)
    start_mm = np.roll(fitted.fit.start_mm, front)
    at_ball_um = (fitted.fit.crossing_mm - np.roll(pivot_mm, -front)[:2]) * UM_PER_MM
    position = dict(zip(CODES[fitted.letter][:2], at_ball_um.tolist(), strict=True))

    def beside_um(considered: Mapping[str, float]) -> FloatArray:
        axis = actual_axis(fitted.letter, considered, pivot_mm)
        starts = np.broadcast_to(start_mm, measured_mm.shape)
        return (measured_mm - axis.turn(starts, fitted.angles_rad)) * UM_PER_MM

    return PathErrors(beside_um({}), beside_um(position), beside_um(errors))


def _errors(
    fitted: FittedPoints, crossing_mm: FloatArray, pivot_mm: FloatArray
) -> dict[str, float]:
    """Name position and, where it was fitted, direction by their codes."""
    nominal = np.roll(pivot_mm, -_FRONT[fitted.letter])[:2]
    position = (crossing_mm - nominal) * UM_PER_MM
    if np.abs(position).max() > VALUE_LIMIT:
        raise InvalidContent.of_field(
            "pivot_mm",
            f"expected a point of the nominal axis within {VALUE_LIMIT / UM_PER_MM:g} mm of the "
            f"actual one, got {nominal.tolist()} mm where the axis is at "
            f"{crossing_mm.round(1).tolist()} mm",
        )
    values = [*position.tolist(), *(fitted.fit.tilts_rad * URAD_PER_RAD).tolist()]
    return dict(zip(CODES[fitted.letter][: len(fitted.fit.cofactor)], values, strict=False))


def _tables(
    errors: Mapping[str, float], covariance: FloatArray | None
) -> tuple[ComponentTable, ...]:
    """Make each component's table with its own variance."""
    return tuple(
        ComponentTable.make(
            COMPONENTS[code],
            [error],
            covariance=None if covariance is None else [[covariance[i, i]]],
        )
        for i, (code, error) in enumerate(errors.items())
    )


def _checked_axis(axis: str) -> str:
    letter = axis.lower() if isinstance(axis, str) else ""
    if letter not in CODES:
        raise InvalidContent.of_field("axis", f"expected rotary axis A, B or C, got {axis!r}")
    return letter
