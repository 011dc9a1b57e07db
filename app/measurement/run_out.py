"""Run-out of a rotary axis: what a fitted axis leaves of the places of its ball."""

from __future__ import annotations

from typing import Final

import numpy as np

from app.arrays import FloatArray

WAYS: Final = ("radial", "tangential", "axial")

ENOUGH_ANGLES: Final = 8
"""Mean, once and twice per turn are five unknowns."""

WORST_CONDITION: Final = 3.0
"""Of evenly spread angles it is √2; an arc cannot tell once from twice per turn."""


def run_out(residuals_um: FloatArray, angles_rad: FloatArray) -> dict[str, float]:
    """Sum up radial, tangential and axial residuals.

    Parameters
    ----------
    residuals_um : ndarray, shape (n, 3) [µm]
        Radial (outward), tangential and axial residual of every point.
    angles_rad : ndarray, shape (n,) [rad]
        Its angle.

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
        figures[f"{way}_rms_um"] = float(np.sqrt(np.mean(values**2)))
    return figures | _harmonics(residuals_um, angles_rad)


def _harmonics(residuals_um: FloatArray, angles_rad: FloatArray) -> dict[str, float]:
    turns = (np.cos(angles_rad), np.sin(angles_rad), np.cos(2 * angles_rad), np.sin(2 * angles_rad))
    design = np.column_stack([np.ones_like(angles_rad), *turns])
    different = np.unique(np.round(np.column_stack(turns[:2]), 3), axis=0)
    if len(different) < ENOUGH_ANGLES or np.linalg.cond(design) > WORST_CONDITION:
        return {}
    found, *_ = np.linalg.lstsq(design, residuals_um, rcond=None)
    once, twice = np.hypot(found[1], found[2]), np.hypot(found[3], found[4])
    return {
        "radial_once_per_turn_um": float(once[0]),
        "radial_twice_per_turn_um": float(twice[0]),
        "axial_twice_per_turn_um": float(twice[2]),
    }
