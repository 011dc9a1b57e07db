"""Take the positions of a measurement and the runs of readings over them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray, frozen
from app.errors import InvalidContent, counted
from app.measurement.stated_numbers import FARTHEST_MM, LARGEST_UM, as_numbers


def as_positions(field: str, stated_mm: ArrayLike) -> FloatArray:
    """Take positions along an axis.

    Parameters
    ----------
    field
        Field that states them.
    stated_mm : array-like, shape (m,) [mm]
        Strictly increasing, at least one.

    Returns
    -------
    ndarray, shape (m,) [mm]

    Raises
    ------
    InvalidContent
        If they are none, not increasing, not finite or beyond 100 m.
    """
    positions = as_numbers(field, stated_mm, "mm", FARTHEST_MM, "perhaps in µm")
    if positions.ndim != 1 or positions.size == 0:
        raise InvalidContent.of_field(
            field, f"expected a list of positions in mm, came an array of shape {positions.shape}"
        )
    wrong = np.flatnonzero(np.diff(positions) <= 0)
    if wrong.size:
        i = int(wrong[0])
        raise InvalidContent.of_field(
            field,
            f"expected strictly increasing positions in mm, came {positions[i]:g} then "
            f"{positions[i + 1]:g} mm (index {i + 1}); give the readings in the same order",
        )
    return frozen(positions)


def as_runs(field: str, stated: ArrayLike, positions: int, unit: str) -> FloatArray:
    """Take the readings of one run, or of several.

    Parameters
    ----------
    field
        Field that states them.
    stated : array-like, shape (m,) or (n, m) [unit]
        One reading for each position in each run.
    positions
        Number m of positions.
    unit
        `µm` or `µrad`.

    Returns
    -------
    ndarray, shape (n, m)

    Raises
    ------
    InvalidContent
        If their number is another, or they are not finite or above 10 mm or 10 mrad.
    """
    of_length = "perhaps in nm, or positions instead of deviations"
    hint = of_length if unit == "µm" else "perhaps in another unit"
    return over_positions(field, as_numbers(field, stated, unit, LARGEST_UM, hint), positions, unit)


def over_positions(field: str, readings: FloatArray, positions: int, unit: str) -> FloatArray:
    """Take readings as runs over positions.

    Parameters
    ----------
    field
        Field that states them.
    readings : ndarray, shape (m,) or (n, m) [unit]
        One run, or several.
    positions
        Number m of positions.
    unit
        Their unit, for the sentence.

    Returns
    -------
    ndarray, shape (n, m)

    Raises
    ------
    InvalidContent
        If there is no run, or one of another number of readings.
    """
    runs = readings[None] if readings.ndim == 1 else readings
    if runs.ndim != 2 or runs.shape[0] == 0 or runs.shape[1] != positions:
        readings_each = counted(positions, "reading")
        raise InvalidContent.of_field(
            field,
            f"expected {readings_each} in {unit}, one for each position, or runs of "
            f"{readings_each} in {unit}, came an array of shape {readings.shape}",
        )
    return runs
