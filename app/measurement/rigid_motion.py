"""How points in a plane lay: the shift and the rotation that bring them to their nominal places.

References
----------
P. H. Schönemann, *A generalized solution of the orthogonal Procrustes problem*,
Psychometrika 31, 1–10 (1966); in the plane, the argument of one complex sum.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.arrays import FloatArray
from app.errors import InvalidContent
from app.measurement.stated_numbers import LARGEST_UM
from app.units import UM_PER_MM, URAD_PER_RAD

ComplexArray = NDArray[np.complex128]

UNTURNED: Final = 1e-6
"""Least size of a sum that has an argument [mm²]."""


class RigidMotion(NamedTuple):
    """How a plate lay, and the holes' errors without it."""

    rotation_urad: float
    shift_mm: FloatArray
    errors_um: FloatArray


def take_out_rigid_motion(nominal_mm: FloatArray, measured_mm: FloatArray) -> RigidMotion:
    """Fit shift and rotation by least squares, and take them out.

    Parameters
    ----------
    nominal_mm, measured_mm : ndarray, shape (n, 2) [mm]
        Nominal and measured x, y of the same holes.

    Returns
    -------
    RigidMotion
        The rotation about Z by the right-hand rule, the place of the nominal zero, and the
        errors in the nominal directions.

    Raises
    ------
    InvalidContent
        If a hole remains more than 10 mm beside its nominal place.

    Notes
    -----
    With both sets counted from their means, the rotation is the argument of Σ n̄ m: exact,
    not linearised.

    Examples
    --------
    >>> square = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 100.0], [0.0, 100.0]])
    >>> turned = square @ [[0.0, 1.0], [-1.0, 0.0]] + [5.0, 7.0]
    >>> motion = take_out_rigid_motion(square, turned)
    >>> round(motion.rotation_urad), motion.shift_mm.round(9).tolist()
    (1570796, [5.0, 7.0])
    """
    n, m = _complex(nominal_mm), _complex(measured_mm)
    n_mean, m_mean = n.mean(), m.mean()
    n, m = n - n_mean, m - m_mean
    turned = np.vdot(n, m)
    turn = turned / abs(turned) if abs(turned) > 0 else 1.0 + 0.0j
    errors = m * np.conj(turn) - n
    _expect_small(errors, n, m)
    shift = m_mean - turn * n_mean
    return RigidMotion(
        rotation_urad=float(np.angle(turn)) * URAD_PER_RAD,
        shift_mm=np.array([shift.real, shift.imag]),
        errors_um=np.column_stack([errors.real, errors.imag]) * UM_PER_MM,
    )


def _complex(points: FloatArray) -> ComplexArray:
    return points[:, 0] + 1j * points[:, 1]


def _expect_small(errors_mm: ComplexArray, n: ComplexArray, m: ComplexArray) -> None:
    worst = int(np.abs(errors_mm).argmax())
    if abs(errors_mm[worst]) * UM_PER_MM <= LARGEST_UM:
        return
    seen_from_behind = np.conj(n)
    turned = np.vdot(seen_from_behind, m)
    left = np.abs(m * np.conj(turned) / max(abs(turned), UNTURNED) - seen_from_behind)
    perhaps = (
        "mirrored (seen from the other side, or x and y exchanged)"
        if left.max() * UM_PER_MM <= LARGEST_UM
        else "in another order or another unit"
    )
    raise InvalidContent.of_field(
        "measured_mm",
        f"expected each hole within {LARGEST_UM / UM_PER_MM:g} mm of its nominal place after a "
        f"shift and a rotation, came {abs(errors_mm[worst]):.3g} mm at index {worst}: perhaps "
        f"{perhaps}",
    )
