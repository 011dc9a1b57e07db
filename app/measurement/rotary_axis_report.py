"""What an R-test says beside its components: figures of quality, and notes in sentences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import chdtrc, stdtrit

from app.arrays import FloatArray, rms
from app.errors import counted, list_names
from app.geometry.components import LINEAR_LETTERS
from app.geometry.rotary_axes import AXIS_LETTERS, about, cyclic_codes
from app.measurement.axis_of_rotation import AxisFit, fit_axis
from app.measurement.rotary_axis_points import arc_deg, number_places, position_per_um, urad_per_um
from app.thermal.error_map import LARGEST_ERROR_UM
from app.units import UM_PER_MM, URAD_PER_RAD

CODES: Final = {letter: cyclic_codes(letter) for letter in AXIS_LETTERS}
"""First and second coordinate, and the tilts about them, of each rotary axis."""

WEAK_POSITION: Final = 2.0
WEAK_DIRECTION_URAD: Final = 50.0
"""What 1 µm of noise may do to the axis before a note says so."""

LARGEST_URAD: Final = 0.01 * URAD_PER_RAD
FEW_DEGREES_OF_FREEDOM: Final = 6
SIGNIFICANT: Final = 0.01


WAYS: Final = ("radial", "tangential", "axial")
ENOUGH_ANGLES: Final = 8
"""Mean, once and twice per turn are five unknowns."""

WORST_CONDITION: Final = 3.0
"""Of evenly spread angles it is √2; an arc cannot tell once from twice per turn."""


@dataclass(frozen=True, slots=True, eq=False)
class FittedPoints:
    """A fitted axis beside the points that it was fitted to.

    Parameters
    ----------
    letter
        `a`, `b` or `c`.
    fit
        The axis, in coordinates of which the last runs along the nominal axis.
    points_mm : ndarray, shape (n, 3) [mm]
        The points, in the same coordinates.
    angles_rad : ndarray, shape (n,) [rad]
    repeatability_um
        Standard deviation of one coordinate as stated [µm], or None.
    """

    letter: str
    fit: AxisFit
    points_mm: FloatArray
    angles_rad: FloatArray
    repeatability_um: float | None

    @property
    def degrees_of_freedom(self) -> int:
        """Coordinates beyond the unknowns."""
        return self.points_mm.size - self.fit.unknowns

    @property
    def noise_um(self) -> float | None:
        """Standard deviation of one coordinate, of the residuals or as stated [µm]."""
        if not self.degrees_of_freedom:
            return self.repeatability_um
        squares = np.sum((self.points_mm - self.fit.fitted_mm) ** 2)
        return float(np.sqrt(squares / self.degrees_of_freedom)) * UM_PER_MM

    def covariance_of(self, cofactor: FloatArray) -> FloatArray | None:
        """Scale a cofactor of the fit by the noise.

        Parameters
        ----------
        cofactor : ndarray, shape (4, 4) or (2, 2) [mm², mm·rad, rad² per mm²]
            Of the axis at some height.

        Returns
        -------
        ndarray, same shape, or None [µm², µm·µrad, µrad²]
            None where nothing tells the noise.
        """
        if self.noise_um is None:
            return None
        scale = np.full(len(cofactor), self.noise_um)
        scale[2:] *= URAD_PER_RAD / UM_PER_MM
        return cofactor * np.outer(scale, scale)

    def residuals_um(self) -> FloatArray:
        """Turn measured minus fitted places to radial, tangential and axial.

        Returns
        -------
        ndarray, shape (n, 3) [µm]
        """
        line = self.fit.line
        arm = self.fit.fitted_mm - line.point_mm
        arm = arm - np.outer(arm @ line.direction, line.direction)
        radial = arm / np.linalg.norm(arm, axis=1, keepdims=True)
        ways = (
            radial,
            np.cross(line.direction, radial),
            np.broadcast_to(line.direction, arm.shape),
        )
        residuals = (self.points_mm - self.fit.fitted_mm) * UM_PER_MM
        return np.column_stack([(residuals * way).sum(axis=1) for way in ways])


def figures_of(fitted: FittedPoints) -> dict[str, float]:
    """Sum up how good an R-test is.

    Returns
    -------
    dict
        The unit is in each name. The place of the axis at the ball's height stands
        beside its components, as it is better known than where it crosses 0.
    """
    letter, fit = fitted.letter, fitted.fit
    at_ball = fitted.covariance_of(fit.cofactor)
    figures = {
        "points": float(fitted.angles_rad.size),
        "arc_deg": arc_deg(fitted.angles_rad),
        "radius_mm": fit.radius_mm,
        "degrees_of_freedom": float(fitted.degrees_of_freedom),
    }
    if fitted.noise_um is not None:
        figures["noise_um"] = fitted.noise_um
    for i, code in enumerate(CODES[letter][:2]):
        name = f"axis_{code[0].lower()}_at_ball"
        figures[f"{name}_mm"] = float(fit.crossing_mm[i])
        if at_ball is not None:
            figures[f"{name}_standard_error_um"] = float(np.sqrt(at_ball[i, i]))
    figures["position_um_per_um_of_noise"] = position_per_um(fit)
    direction = urad_per_um(fit)
    if direction is None:
        return figures | {"axial_range_um": float(np.ptp(fitted.points_mm[:, 2])) * UM_PER_MM}
    figures["direction_urad_per_um_of_noise"] = direction
    return figures | run_out(fitted.residuals_um(), fitted.angles_rad)


def notes_on(fitted: FittedPoints, errors: Mapping[str, float]) -> tuple[str, ...]:
    """Say what an R-test does not see and what looks weak or wrong.

    Parameters
    ----------
    errors
        Its location errors [µm, µrad].
    """
    notes = [
        "Errors of X, Y and Z at the points count as errors of the rotary axis; its own angular "
        "positioning shows in the tangential residuals."
    ]
    if len(errors) == 2:
        notes.append(_without_direction(fitted))
    return (*notes, *_weak_arc(fitted), *_about_noise(fitted), *_about_size(errors))


def _without_direction(fitted: FittedPoints) -> str:
    """Say why there is no direction, and what that means for the position."""
    first, second, tilt, other = CODES[fitted.letter]
    along = LINEAR_LETTERS[about(fitted.letter)]
    reason = "Two different angles do not determine the direction"
    if np.unique(number_places(np.rad2deg(fitted.angles_rad))).size > 2:
        tilts = urad_per_um(fit_axis(fitted.points_mm, fitted.angles_rad)) or np.inf
        reason = (
            f"The angles do not determine the direction (1 µm of noise would tilt the axis by "
            f"{tilts:.0f} µrad)"
        )
    return (
        f"{reason}: {first} and {second} are those of "
        f"an axis of nominal direction through its place at {along} = "
        f"{fitted.fit.height_mm:.6g} mm; each µrad of {tilt} or {other} moves them by "
        f"{abs(fitted.fit.height_mm) * UM_PER_MM / URAD_PER_RAD:.3g} µm at {along} = 0."
    )


def _weak_arc(fitted: FittedPoints) -> list[str]:
    position, direction = position_per_um(fitted.fit), urad_per_um(fitted.fit)
    if position < WEAK_POSITION and (direction or 0.0) < WEAK_DIRECTION_URAD:
        return []
    tilts = "" if direction is None else f" and tilts it by {direction:.2g} µrad"
    return [
        f"The points over {arc_deg(fitted.angles_rad):.3g}° at a radius of "
        f"{fitted.fit.radius_mm:.3g} mm show the axis weakly: 1 µm of noise moves it by "
        f"{position:.2g} µm at the ball{tilts}."
    ]


def _about_noise(fitted: FittedPoints) -> list[str]:
    freedom, noise = fitted.degrees_of_freedom, fitted.noise_um
    if noise is None:
        return ["Nothing tells the noise: no redundancy, and no repeatability_um was stated."]
    if not freedom:
        return ["Standard errors follow from the repeatability stated, as nothing is redundant."]
    notes = []
    if freedom < FEW_DEGREES_OF_FREEDOM:
        notes.append(
            f"Standard errors rest on {counted(freedom, 'degree')} of freedom: 95 % of the cases "
            f"are within {stdtrit(freedom, 0.975):.3g} of them."
        )
    repeatability = fitted.repeatability_um
    if repeatability and chdtrc(freedom, freedom * (noise / repeatability) ** 2) < SIGNIFICANT:
        notes.append(
            f"The residuals' {noise:.3g} µm are more than the stated repeatability of "
            f"{repeatability:.3g} µm explains: run-out, or errors of the linear axes."
        )
    return notes


def _about_size(errors: Mapping[str, float]) -> list[str]:
    notes = []
    far = [code for code in list(errors)[:2] if abs(errors[code]) > LARGEST_ERROR_UM]
    steep = [code for code in list(errors)[2:] if abs(errors[code]) > LARGEST_URAD]
    if far:
        notes.append(
            f"{list_names(far)} beyond {LARGEST_ERROR_UM:g} µm: the place of the axis in these "
            "coordinates rather than its error; pivot_mm states a point of the nominal axis."
        )
    if steep:
        notes.append(
            f"{list_names(steep)} beyond {LARGEST_URAD:g} µrad is suspicious: another tilting "
            "axis may have stood away from 0."
        )
    return notes


def run_out(residuals_um: FloatArray, angles_rad: FloatArray) -> dict[str, float]:
    """Sum up radial, tangential and axial residuals.

    Parameters
    ----------
    residuals_um : ndarray, shape (n, 3) [µm]
        Radial (outward), tangential and axial residual of every point.
    angles_rad : ndarray, shape (n,) [rad]

    Returns
    -------
    dict
        Range (largest less smallest) and root mean square each way [µm]. Where at least
        ENOUGH_ANGLES angles lie around the turn, also the amplitudes of the harmonics
        once and twice per turn that a fit leaves [µm].

    Notes
    -----
    A fitted axis takes up what looks like a shift or a tilt of it: all of the axial
    once per turn, therefore not given, and half of a purely radial once per turn. Twice
    per turn is left whole.

    Examples
    --------
    >>> angles = np.deg2rad(np.arange(0.0, 360.0, 30.0))
    >>> wave = 3.0 * np.cos(2 * angles)
    >>> found = run_out(np.column_stack([wave, 0 * wave, 0 * wave]), angles)
    >>> round(found["radial_range_um"], 9), round(found["radial_twice_per_turn_um"], 9)
    (6.0, 3.0)
    """
    figures = {}
    for way, values in zip(WAYS, residuals_um.T, strict=True):
        figures[f"{way}_range_um"] = float(np.ptp(values))
        figures[f"{way}_rms_um"] = rms(values)
    return figures | _harmonics(residuals_um, angles_rad)


def _harmonics(residuals_um: FloatArray, angles_rad: FloatArray) -> dict[str, float]:
    turns = (np.cos(angles_rad), np.sin(angles_rad), np.cos(2 * angles_rad), np.sin(2 * angles_rad))
    design = np.column_stack([np.ones_like(angles_rad), *turns])
    different = np.unique(np.round(np.column_stack(turns[:2]), 3), axis=0)
    if len(different) < ENOUGH_ANGLES or np.linalg.cond(design) > WORST_CONDITION:
        return {}
    coefficients, *_ = np.linalg.lstsq(design, residuals_um, rcond=None)
    once, twice = (
        np.hypot(coefficients[1], coefficients[2]),
        np.hypot(coefficients[3], coefficients[4]),
    )
    return {
        "radial_once_per_turn_um": float(once[0]),
        "radial_twice_per_turn_um": float(twice[0]),
        "axial_twice_per_turn_um": float(twice[2]),
    }
