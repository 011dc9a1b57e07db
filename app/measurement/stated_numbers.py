"""Take the numbers that a user states, and refuse those that cannot be true.

What is certain to be wrong is refused in the same words by every method; what is only
suspicious is noted.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from app.arrays import FloatArray
from app.errors import InvalidContent
from app.thermal.error_map import LARGEST_ERROR_UM
from app.units import MM_PER_M

FARTHEST_MM: Final = 100 * MM_PER_M
"""Positions beyond 100 m are none of a machine tool."""

SUSPICIOUSLY_SMALL_UM: Final = 0.05
"""Where every reading is less, they may be in mm."""

Place: TypeAlias = Callable[[list[int]], str]
"""Says in words which of the numbers an index means."""


def as_array(field: str, values: ArrayLike, expected: str, rows: str = "rows") -> FloatArray:
    """Take numbers as an array, whatever their sizes.

    Parameters
    ----------
    values : array-like
    expected, rows
        What they are with their unit, and what their rows are, for the sentence.

    Returns
    -------
    ndarray, same shape

    Raises
    ------
    InvalidContent
        If something is no number, or rows are of unequal length.
    """
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidContent.of_field(
            field, f"expected {expected}, got {rows} of unequal length or no numbers"
        ) from None


def expect_plausible(
    field: str,
    numbers: FloatArray,
    unit: str,
    largest: float = math.inf,
    hint: str = "",
    *,
    what: str = "numbers",
    place: Place | None = None,
) -> None:
    """Refuse what is not finite, or too large to be a number of that unit.

    Parameters
    ----------
    numbers : ndarray, of any shape [unit]
    hint
        What a larger one may be instead.
    what
        What they are, for the sentence.
    place
        Names the place of a number that is not finite; by its index where left out.

    Raises
    ------
    InvalidContent
        If there is such a number; the sentence names the first that is not finite, or the
        largest.
    """
    wrong = np.argwhere(~np.isfinite(numbers))
    if wrong.size:
        at = wrong[0].tolist()
        where = f"{unit} at index {at}" if place is None else place(at)
        raise InvalidContent.of_field(
            field, f"expected finite {what} in {unit}, got {numbers[tuple(at)]:g} {where}"
        )
    if numbers.size and np.abs(numbers).max() > largest:
        at = [int(i) for i in np.unravel_index(np.abs(numbers).argmax(), numbers.shape)]
        raise InvalidContent.of_field(
            field,
            f"expected {what} within ±{largest:g} {unit}, got {numbers[tuple(at)]:g} {unit}: "
            f"{hint} (index {at})",
        )


def expect_displacements(field: str, readings_um: FloatArray, place: Place) -> None:
    """Refuse what cannot be displacements less their nominal.

    Parameters
    ----------
    readings_um : ndarray, of any shape [µm]
        The readings along a diagonal.
    place
        As for `expect_plausible`.

    Raises
    ------
    InvalidContent
        If a reading is not finite or above 10 mm.
    """
    hint = "are they in nm, or is the nominal displacement still in them?"
    what = "displacements less their nominal"
    expect_plausible(field, readings_um, "µm", LARGEST_ERROR_UM, hint, what=what, place=place)


def as_numbers(
    field: str, values: ArrayLike, unit: str, largest: float = math.inf, hint: str = ""
) -> FloatArray:
    """Take numbers as an array, and refuse what is no number of that unit.

    Parameters
    ----------
    values : array-like
    unit, largest, hint
        As for `expect_plausible`.

    Returns
    -------
    ndarray, same shape

    Raises
    ------
    InvalidContent
        If rows are of unequal length, or a number is not finite or too large.

    Examples
    --------
    >>> as_numbers("pivot_mm", [0, 1, 2], "mm").tolist()
    [0.0, 1.0, 2.0]
    """
    numbers = as_array(field, values, f"numbers in {unit}, rows of equal length")
    expect_plausible(field, numbers, unit, largest, hint)
    return numbers


def as_point(field: str, stated_mm: ArrayLike, largest: float = FARTHEST_MM) -> FloatArray:
    """Take a point of the machine's space.

    Parameters
    ----------
    stated_mm : array-like, shape (3,) [mm]
    largest
        Greatest coordinate that can be true [mm].

    Returns
    -------
    ndarray, shape (3,) [mm]

    Raises
    ------
    InvalidContent
        If it has not three finite coordinates, or one of them is too large.
    """
    point = as_numbers(field, stated_mm, "mm", largest, "perhaps in µm")
    if point.shape != (3,):
        raise InvalidContent.of_field(
            field, f"expected x, y and z of a point in mm, got an array of shape {point.shape}"
        )
    return point


def as_standard_deviation(
    field: str,
    deviation: float | None,
    unit: str,
    *,
    largest: float = LARGEST_ERROR_UM,
    zero: bool = True,
) -> float | None:
    """Take a stated standard deviation.

    Parameters
    ----------
    deviation
        The number, or None where nobody knows.
    largest
        Greatest that can be true; infinite where there is no such limit.
    zero
        Whether 0 is allowed.

    Raises
    ------
    InvalidContent
        If it is negative, not finite, implausibly large, or 0 where that is not allowed.
    """
    if deviation is None or (
        math.isfinite(deviation) and 0 <= deviation <= largest and (zero or deviation)
    ):
        return deviation
    limits = f"from 0 to {largest:g} {unit}"
    if math.isinf(largest):
        limits = f"of {'0 or more' if zero else 'more than 0'} in {unit}"
    raise InvalidContent.of_field(
        field, f"expected a standard deviation {limits}, got {deviation:g} {unit}"
    )


def suspiciously_small(field: str, readings: FloatArray, *, zeros: bool = False) -> list[str]:
    """Note readings so small that they may be millimetres.

    Parameters
    ----------
    readings : ndarray, of any shape [µm]
    zeros
        Whether readings that are all 0 are noted too.
    """
    largest = float(np.abs(readings).max())
    if largest >= SUSPICIOUSLY_SMALL_UM or not (largest or zeros):
        return []
    return [
        f"No reading is larger than {largest:.3g} µm ({field}): they may be in mm instead of µm; "
        "if the readings are in mm, what comes out is a thousand times too small."
    ]
