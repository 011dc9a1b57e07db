"""What a laser would read on the sequential step diagonals of a machine with known errors.

The machine is walked through each single step, and the volumetric error's change is
projected on the diagonal: for training, for planning a measurement, and as the truth
against which the derivation is held. It shares no formula with the derivation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray
from app.errors import InvalidContent, list_names
from app.geometry.body_diagonal import DIAGONALS, diagonal_ends
from app.geometry.error_field import ErrorField
from app.geometry.volumetric_error import NO_TOOL
from app.geometry.work_volume import WorkVolume
from app.units import um_from_urad_mm

Target: TypeAlias = Literal["point", "flat-mirror"]
"""What the beam meets: a point of the tool, or a plane that may tilt with it."""

TARGETS: Final = ("point", "flat-mirror")

Tilts: TypeAlias = Mapping[str, Sequence[float]]
"""Diagonal to the two small angles between its mirror's normal and itself [µrad]."""


def step_diagonal_readings(
    field: ErrorField,
    origin_mm: ArrayLike,
    step_mm: ArrayLike,
    steps: int,
    *,
    tool_offset_mm: ArrayLike = NO_TOOL,
    diagonals: Sequence[str] = DIAGONALS,
    target: Target = "point",
    mirror_tilts_urad: Tilts | None = None,
    noise_um: float = 0.0,
    rng: np.random.Generator | None = None,
    resolution_um: float | None = None,
) -> dict[str, FloatArray]:
    """Walk the machine along each diagonal, x then y then z, and say what is read.

    Parameters
    ----------
    origin_mm, step_mm : array-like, shape (3,) [mm]
        Lowest corner of the volume, and the positive steps X, Y, Z.
    tool_offset_mm : array-like, shape (3,) [mm]
        Tool offset T of the target's middle.
    diagonals
        Which of `ppp`, `npp`, `pnp`, `ppn` to walk.
    target
        `point`: the error of one point of the tool is projected. `flat-mirror`: the
        beam stays where it is while the mirror moves sideways across it, so that the
        mirror's rotations act on the point that the beam meets.
    mirror_tilts_urad
        Diagonal to two angles [µrad]: the mirror's normal is r + a·e₁ + b·e₂ with e₁
        along k × r (horizontal) and e₂ = r × e₁. Diagonals left out are aligned.
    noise_um
        Standard deviation of one reading, that of the zero at the start included [µm].
    rng
        Source of the noise; needed where there is noise.
    resolution_um
        Readings are rounded to multiples of this [µm]; not rounded where left out.

    Returns
    -------
    dict of diagonal to ndarray, shape (n, 3) [µm]
        Displacement along the diagonal since its start less its nominal, after x, after
        y and after z have moved.

    Raises
    ------
    InvalidContent
        If there is no step, a diagonal is unknown, or noise is wanted without a source.

    Notes
    -----
    A positive reading: the machine went too far along r. [V 6] counts the traverse of an
    axis that runs backwards with its sign already reversed; here r and the movement both
    have their own signs.

    Examples
    --------
    x is 10 µm/m too long: a step of 30 mm is 0.3 µm too long, of which a beam at
    x/r = 0.6 sees 0.18 µm; y and z add nothing.

    >>> from app.geometry.chain import Chain
    >>> from app.geometry.error_table import Table
    >>> field = ErrorField.make(Chain.parse("XYFZ"), {"EXX": Table([0.0, 60.0], [0.0, 0.6])})
    >>> step_diagonal_readings(field, [0, 0, 0], [30.0, 24.0, 32.0], 2)["npp"].round(3).tolist()
    [[0.18, 0.18, 0.18], [0.36, 0.36, 0.36]]
    """
    field.expect_one_state()
    expect_target(target)
    _check(steps, noise_um, rng)
    low = np.asarray(origin_mm, dtype=np.float64)
    high = low + steps * np.asarray(step_mm, dtype=np.float64)
    x, y, z = zip(low.tolist(), high.tolist(), strict=True)
    volume = WorkVolume(x, y, z)
    simulated = {}
    for diagonal in diagonals:
        start, end = diagonal_ends(volume, diagonal)
        ray = (end - start) / np.linalg.norm(end - start)
        points = _walk(start, (end - start) / steps, steps)
        offsets = np.asarray(tool_offset_mm, dtype=np.float64) - _beside(points, ray, target)
        errors_um, _ = field.at(points, offsets)
        tilt = _tilt(ray, (mirror_tilts_urad or {}).get(diagonal, (0.0, 0.0)))
        readings = errors_um @ ray + um_from_urad_mm(1.0) * ((points - start) @ tilt)
        if rng is not None and noise_um:
            readings = readings + rng.normal(scale=noise_um, size=readings.size)
        readings = (readings - readings[0])[1:].reshape(steps, 3)
        simulated[diagonal] = _rounded(readings, resolution_um)
    return simulated


def expect_target(target: str) -> None:
    """Refuse a target that nobody knows."""
    if target not in TARGETS:
        raise InvalidContent.of_field("target", f"expected {list_names(TARGETS)}, got {target!r}")


def _walk(start: FloatArray, step: FloatArray, steps: int) -> FloatArray:
    """Visit the start and each point after one axis has moved: shape (3n + 1, 3) [mm]."""
    points = [start]
    for _ in range(steps):
        for axis in range(3):
            here = points[-1].copy()
            here[axis] += step[axis]
            points.append(here)
    return np.array(points)


def _beside(points: FloatArray, ray: FloatArray, target: Target) -> FloatArray:
    """How far the target's middle stands beside the beam, which meets it elsewhere [mm]."""
    travelled = points - points[0]
    if target == "point":
        return np.zeros_like(travelled)
    beside: FloatArray = travelled - np.outer(travelled @ ray, ray)
    return beside


def _tilt(ray: FloatArray, angles_urad: Sequence[float]) -> FloatArray:
    """What a mirror's normal has beside the diagonal [µrad]."""
    level = np.cross([0.0, 0.0, 1.0], ray)
    level = level / np.linalg.norm(level)
    first, second = angles_urad
    tilt: FloatArray = first * level + second * np.cross(ray, level)
    return tilt


def _rounded(readings_um: FloatArray, resolution_um: float | None) -> FloatArray:
    if resolution_um is None:
        return readings_um
    rounded: FloatArray = np.round(readings_um / resolution_um) * resolution_um
    return rounded


def _check(steps: int, noise_um: float, rng: np.random.Generator | None) -> None:
    if steps < 1:
        raise InvalidContent.of_field("steps", f"expected at least 1 step, got {steps}")
    if not noise_um >= 0.0 or (noise_um and rng is None):
        raise InvalidContent.of_field(
            "noise_um",
            f"expected a standard deviation in µm and a random generator for it, got {noise_um:g}",
        )
