"""How many times larger than they are errors must be drawn to be seen."""

from __future__ import annotations

import math
from typing import Final

from app.errors import InvalidContent
from app.geometry.work_volume import WorkVolume
from app.units import UM_PER_MM

SHARE: Final = 0.12
"""Of the volume's typical side, that the largest error is drawn as long as."""

LEAST_UM: Final = 1e-6
"""Errors below a picometre are rounding: they are drawn as none."""

MOST_DIAGONALS: Final = 2.0
"""Errors drawn longer than so many diagonals of the volume leave nothing to recognize."""


def automatic_exaggeration(largest_um: float, volume: WorkVolume) -> float:
    """Choose a round factor that makes the largest error easy to see.

    Parameters
    ----------
    largest_um
        Length of the largest error in the volume [µm].
    volume
        The work volume, longer than nothing along at least one axis.

    Returns
    -------
    float
        1, 2 or 5 times a power of ten: the largest error is drawn some 12 % (8 to
        19 %) as long as the volume's typical side. 1 where there is no error.

    Notes
    -----
    Typical is the geometric mean of the shortest and the longest side that are not 0:
    a cube's side. For a gantry of 30 m the shortest side would draw errors of a few
    pixels, and the longest one errors longer than the box is high.

    Examples
    --------
    >>> volume = WorkVolume((0.0, 500.0), (0.0, 500.0), (0.0, 400.0))
    >>> automatic_exaggeration(43.0, volume)
    1000.0
    """
    if largest_um < LEAST_UM:
        return 1.0
    sides_mm = [high - low for low, high in volume.ranges_mm if high > low]
    typical_mm = math.sqrt(min(sides_mm) * max(sides_mm))
    return _nearest_round(SHARE * typical_mm * UM_PER_MM / largest_um)


def checked_exaggeration(exaggeration: float, largest_um: float, volume: WorkVolume) -> float:
    """Refuse a factor that draws no picture.

    Parameters
    ----------
    largest_um
        Length of the largest error in the volume [µm].

    Raises
    ------
    InvalidContent
        If it is not above 0, not finite, or draws the largest error longer than two
        diagonals of the volume.

    Examples
    --------
    >>> checked_exaggeration(500.0, 43.0, WorkVolume((0.0, 500.0), (0.0, 0.0), (0.0, 400.0)))
    500.0
    """
    if not (math.isfinite(exaggeration) and exaggeration > 0):
        raise InvalidContent.of_field(
            "exaggeration", f"expected a finite factor above 0, got {exaggeration:g}"
        )
    most_um = MOST_DIAGONALS * volume.diagonal_mm * UM_PER_MM
    if not exaggeration * largest_um <= most_um:
        raise InvalidContent.of_field(
            "exaggeration",
            f"expected a factor that draws the largest error, {largest_um:.3g} µm, no longer "
            f"than {MOST_DIAGONALS:g} diagonals of {volume.diagonal_mm:g} mm, "
            f"got {exaggeration:g}",
        )
    return exaggeration


def _nearest_round(value: float) -> float:
    """The nearest 1, 2 or 5 times a power of ten, in ratio."""
    power = math.floor(math.log10(value))
    rounds = [float(f"{digit}e{power}") for digit in (1, 2, 5, 10)]
    return min(rounds, key=lambda round_: abs(math.log(round_ / value)))
