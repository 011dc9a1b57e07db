"""Least-squares axis of rotation of the places that one carried ball took at known angles.

The motion is the exact one of Rodrigues ([R] 9, 22: T.-H. Hsieh et al., Geometric error
compensation method using the Laser R-test, 2024), fitted by Levenberg and Marquardt's
iteration; nothing is linearised in what comes out.

All coordinates here are (first, second, along): along the nominal axis last, in cyclic
order. So the one case serves a C axis (x, y, z), an A axis (y, z, x) and a B axis (z, x,
y). The axis direction is (cos τ sin ο, −sin τ, cos τ cos ο) with its tilt τ about the
first and ο about the second coordinate, which is [R] 8 and, in cyclic order, [R] 21.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from app.arrays import FloatArray
from app.geometry.rotary_axes import RotaryAxis

_FINEST = 1e-13
"""Relative change at which the iteration ends: a tenth of a picometre in a metre."""

_MOST_TRIES = 100
"""A ball that turned takes four to eight; other points need not come to an end."""

_UNSEEN = 1e-12
"""Singular values below this share of the largest are a direction that nothing shows."""


@dataclass(frozen=True, slots=True, eq=False)
class AxisFit:
    """The axis about which a ball turned.

    Parameters
    ----------
    height_mm
        Mean coordinate of the ball along the nominal axis [mm].
    crossing_mm : ndarray, shape (2,) [mm]
        First and second coordinate of the axis at that height.
    tilts_rad : ndarray, shape (2,) [rad]
        Rotation of the axis about the first and the second coordinate; 0 where the
        nominal direction was taken for granted.
    start_mm : ndarray, shape (3,) [mm]
        The ball at angle 0.
    fitted_mm : ndarray, shape (n, 3) [mm]
        The ball at the angles, as the fit has it.
    cofactor : ndarray, shape (4, 4), or (2, 2) without direction
        Covariance of crossing and tilts for coordinates whose own variance is 1 mm²
        [mm², mm·rad, rad²].
    """

    height_mm: float
    crossing_mm: FloatArray
    tilts_rad: FloatArray
    start_mm: FloatArray
    fitted_mm: FloatArray
    cofactor: FloatArray
    unknowns: int

    @property
    def line(self) -> RotaryAxis:
        """The axis as a line in space."""
        return RotaryAxis(np.append(self.crossing_mm, self.height_mm), _direction(*self.tilts_rad))

    @property
    def radius_mm(self) -> float:
        """Distance of the ball from the axis [mm]."""
        line = self.line
        return float(np.linalg.norm(np.cross(line.direction, self.start_mm - line.point_mm)))

    def at_height_0(self) -> tuple[FloatArray, FloatArray]:
        """Follow the axis to where the coordinate along it is 0.

        Returns
        -------
        crossing : ndarray, shape (2,) [mm]
        cofactor : ndarray, same shape as `cofactor`
            Of that crossing and of the tilts.
        """
        tilt, other = self.tilts_rad
        # The direction's first two coordinates over its third: how far the axis moves aside per mm.
        slope = np.array([np.tan(other), -np.tan(tilt) / np.cos(other)])
        change = np.eye(len(self.cofactor))
        # The derivatives of −height · slope by both tilts: an axis that is known well at the ball
        # is known less well at a distance from it.
        if len(change) > 2:
            change[0, 3] = -self.height_mm / np.cos(other) ** 2
            change[1, 2] = self.height_mm / (np.cos(tilt) ** 2 * np.cos(other))
            change[1, 3] = self.height_mm * np.tan(tilt) * np.tan(other) / np.cos(other)
        return self.crossing_mm - self.height_mm * slope, change @ self.cofactor @ change.T


def fit_position(points_mm: FloatArray, angles_rad: FloatArray, places: FloatArray) -> AxisFit:
    """Fit where an axis of nominal direction is: enough for two different angles.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3) [mm]
        Places of the ball.
    angles_rad : ndarray, shape (n,) [rad]
        Angles, positive by the right-hand rule.
    places : ndarray, shape (n,)
        Number of the angle that each point repeats.

    Returns
    -------
    AxisFit
        The ball's coordinate along the axis is free at each different angle, as a tilt
        would change it: those coordinates are unknowns too.

    Notes
    -----
    In the plane the ball is at c + R(θ)·p, which is linear in c and p.

    Examples
    --------
    >>> half_a_turn = np.array([[101.0, 2.0, 5.0], [-99.0, 2.0, 5.0]])
    >>> fit = fit_position(half_a_turn, np.array([0.0, np.pi]), np.array([0, 1]))
    >>> fit.crossing_mm.round(9).tolist(), round(fit.radius_mm, 9)
    ([1.0, 2.0], 100.0)
    """
    mean = points_mm.mean(axis=0)
    design = _position_design(angles_rad)
    solution, *_ = np.linalg.lstsq(design, (points_mm - mean)[:, :2].T.ravel(), rcond=None)
    along = [points_mm[places == place, 2].mean() for place in places]
    return AxisFit(
        height_mm=float(mean[2]),
        crossing_mm=mean[:2] + solution[:2],
        tilts_rad=np.zeros(2),
        start_mm=mean + np.append(solution[:2] + solution[2:], 0.0),
        fitted_mm=np.column_stack([mean[:2] + (design @ solution).reshape(2, -1).T, along]),
        cofactor=_cofactor(design)[:2, :2],
        unknowns=solution.size + np.unique(places).size,
    )


def fit_axis(points_mm: FloatArray, angles_rad: FloatArray) -> AxisFit:
    """Fit where an axis is and which way it points: three different angles or more.

    Parameters
    ----------
    points_mm : ndarray, shape (n, 3) [mm]
        Places of the ball.
    angles_rad : ndarray, shape (n,) [rad]
        Angles, positive by the right-hand rule.

    Returns
    -------
    AxisFit
        Seven unknowns: two coordinates and two tilts of the axis, the ball at angle 0.

    Examples
    --------
    >>> askew = RotaryAxis(np.array([1.0, 2.0, 0.0]), _direction(3e-4, -2e-4))
    >>> angles = np.deg2rad([0.0, 90.0, 180.0, 270.0])
    >>> points = askew.turn(np.tile([100.0, 0.0, 50.0], (4, 1)), angles)
    >>> fit = fit_axis(points, angles)
    >>> fit.at_height_0()[0].round(9).tolist(), fit.tilts_rad.round(12).tolist()
    ([1.0, 2.0], [0.0003, -0.0002])
    """
    mean = points_mm.mean(axis=0)
    # About the points' middle: an axis that is placed far from the ball trades position for tilt,
    # and large coordinates lose digits.
    centred = points_mm - mean
    first = fit_position(centred, angles_rad, np.zeros(angles_rad.size))
    # A tilt [rad] moves the ball by its arm [mm]: so scaled, all unknowns act alike.
    size = np.ones(7)
    size[2:4] = 1.0 / max(first.radius_mm, np.linalg.norm(centred, axis=1).max())

    def misfit(unknowns: FloatArray) -> FloatArray:
        residual: FloatArray = (_turned(unknowns, angles_rad) - centred).ravel()
        return residual

    def slopes(unknowns: FloatArray) -> FloatArray:
        return _slopes(unknowns, angles_rad)

    guess = np.concatenate([first.crossing_mm, first.tilts_rad, first.start_mm])
    solution = least_squares(
        misfit, guess, slopes, method="lm", x_scale=size,
        xtol=_FINEST, ftol=_FINEST, gtol=_FINEST, max_nfev=_MOST_TRIES,
    )  # fmt: skip
    # `_cofactor` compares singular values with each other: columns in mm and in rad have to be made
    # alike first.
    scaled = _slopes(solution.x, angles_rad) * size
    cofactor = _cofactor(scaled) * np.outer(size, size)
    return AxisFit(
        height_mm=float(mean[2]),
        crossing_mm=mean[:2] + solution.x[:2],
        tilts_rad=solution.x[2:4],
        start_mm=mean + solution.x[4:],
        fitted_mm=mean + _turned(solution.x, angles_rad),
        cofactor=cofactor[:4, :4],
        unknowns=solution.x.size,
    )


def _direction(tilt: float, other: float) -> FloatArray:
    return np.array([np.cos(tilt) * np.sin(other), -np.sin(tilt), np.cos(tilt) * np.cos(other)])


def _turned(unknowns: FloatArray, angles_rad: FloatArray) -> FloatArray:
    """Turn the ball about the axis that seven unknowns describe."""
    line = RotaryAxis(np.append(unknowns[:2], 0.0), _direction(*unknowns[2:4]))
    return line.turn(np.broadcast_to(unknowns[4:], (angles_rad.size, 3)), angles_rad)


def _slopes(unknowns: FloatArray, angles_rad: FloatArray) -> FloatArray:
    """Differentiate every coordinate of every point by the seven unknowns."""
    tilt, other = unknowns[2:4]
    direction = _direction(tilt, other)
    arm = unknowns[4:] - np.append(unknowns[:2], 0.0)
    n = angles_rad.size
    about = RotaryAxis(np.zeros(3), direction)
    turned = [about.turn(np.broadcast_to(unit, (n, 3)), angles_rad) for unit in np.eye(3)]
    # A shift of the axis moves the ball by itself less the turned shift.
    shifted = [unit - column for unit, column in zip(np.eye(3)[:2], turned[:2], strict=True)]
    # Rodrigues' formula, cos θ · arm + sin θ · d × arm + (1 − cos θ) · d (d · arm), differentiated
    # by the direction d, which a tilt turns about its own axis.
    tilted = []
    # d = R₂(ο) R₁(τ) k: the second rotation is about the second coordinate itself, the first about
    # the first coordinate as the second rotation has turned it.
    for about_tilt in ([np.cos(other), 0.0, -np.sin(other)], [0.0, 1.0, 0.0]):
        change = np.cross(about_tilt, direction)
        swept = change * (arm @ direction) + direction * (arm @ change)
        tilted.append(
            np.outer(np.sin(angles_rad), np.cross(change, arm))
            + np.outer(1.0 - np.cos(angles_rad), swept)
        )
    return np.stack([*shifted, *tilted, *turned], axis=-1).reshape(3 * n, 7)


def _position_design(angles_rad: FloatArray) -> FloatArray:
    """Differentiate the coordinates in the plane by those of the centre and of the arm."""
    cos, sin = np.cos(angles_rad), np.sin(angles_rad)
    ones, zero = np.ones_like(cos), np.zeros_like(cos)
    firsts = np.column_stack([ones, zero, cos, -sin])
    seconds = np.column_stack([zero, ones, sin, cos])
    return np.concatenate([firsts, seconds])


def _cofactor(design: FloatArray) -> FloatArray:
    """Invert the normal equations; what nothing shows becomes as good as infinite."""
    # (AᵀA)⁻¹ = V S⁻² Vᵀ of A's own singular values: AᵀA would have squared their ratio.
    _, singular, rows = np.linalg.svd(design, full_matrices=False)
    clipped = np.maximum(singular, singular[0] * _UNSEEN)
    inverse: FloatArray = (rows.T / clipped**2) @ rows
    return inverse
