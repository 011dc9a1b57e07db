"""Computed numbers are written to 0.1 nm and 0.1 nrad: below any measurement, and short.

Stored values (maps, readings, verifications) are written as they came, and npy and Arrow
have full precision. What others divide by, such as standard errors, is never rounded to
so many decimals, which could make it 0, but to so many digits.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import Annotated, Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import GetPydanticSchema, PlainSerializer
from pydantic_core import core_schema

DECIMALS: Final = 4
"""Of µm, µrad, µm/m and µrad/m."""

DIGITS: Final = 9
"""Of ratios, standard deviations and figures of different units."""

MOST_EXACT: Final = 22
"""The largest power of ten that a number holds exactly."""

SLIGHT: Final = 1e-6
"""So little above a tenth of a nanometre is no reason for the next one [0.1 nm]."""

UNIX_DECIMALS: Final = 3
"""Of times in seconds since 1970, of which nine digits would be ten seconds."""

LARGE: Final = 10.0 ** (DIGITS - UNIX_DECIMALS)
"""Of larger numbers nine digits have fewer decimals."""


def to_tenth_nm(micro: float) -> float:
    """Round µm or µrad to 0.1 nm or 0.1 nrad; −0 becomes 0.

    >>> to_tenth_nm(1.23456789), to_tenth_nm(-0.00001)
    (1.2346, 0.0)
    """
    return round(micro, DECIMALS) + 0.0


def to_digits(number: float) -> float:
    """Round to nine significant digits, however small the number is.

    >>> to_digits(1.0 / 3.0), to_digits(1e-12 / 3.0)
    (0.333333333, 3.33333333e-13)
    """
    return float(f"{number:.{DIGITS}g}") + 0.0


def to_digits_of(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Round an array as `to_digits` does a number.

    >>> to_digits_of(np.array([1.0 / 3.0, 0.0, -2e6 / 3.0])).tolist()
    [0.333333333, 0.0, -666666.667]
    """
    size = np.abs(numbers)
    exponent = np.floor(np.log10(size, where=size > 0.0, out=np.zeros_like(size)))
    scale = 10.0 ** np.clip(DIGITS - 1 - exponent, -MOST_EXACT, MOST_EXACT)
    return np.asarray(np.round(numbers * scale) / scale + 0.0)


def to_digits_or_ms(number: float) -> float:
    """Round to nine digits, but what may be seconds since 1970 to milliseconds.

    >>> to_digits_or_ms(1.0 / 3.0), to_digits_or_ms(1772323200.1234567)
    (0.333333333, 1772323200.123)
    """
    return round(number, UNIX_DECIMALS) if abs(number) > LARGE else to_digits(number)


def to_digits_in(found: Any, stored: Collection[str] = ()) -> Any:
    """Round every computed number of JSON's own types to nine significant digits.

    Parameters
    ----------
    stored
        Names of fields that stay as they came.

    Examples
    --------
    >>> to_digits_in({"rms": 1.0 / 3.0, "of": [2, "x"], "changed_at_unix_s": 1772323200.1234567})
    {'rms': 0.333333333, 'of': [2, 'x'], 'changed_at_unix_s': 1772323200.123}
    """
    if isinstance(found, float):
        return to_digits_or_ms(found)
    if isinstance(found, Mapping):
        return {
            name: value if name in stored else to_digits_in(value, stored)
            for name, value in found.items()
        }
    if isinstance(found, list | tuple):
        return [to_digits_in(value, stored) for value in found]
    return found


def rounded(micro: NDArray[np.float64]) -> NDArray[np.float64]:
    """Round an array of µm or µrad to 0.1 nm or 0.1 nrad.

    Parameters
    ----------
    micro : ndarray, of any shape [µm or µrad]

    Returns
    -------
    ndarray, same shape, contiguous
        Without −0.

    Examples
    --------
    >>> rounded(np.array([1.23456789, -0.00001])).tolist()
    [1.2346, 0.0]
    """
    return np.ascontiguousarray(np.round(micro, DECIMALS) + 0.0)


def rounded_up(micro: NDArray[np.float64]) -> NDArray[np.float64]:
    """Round bounds up to 0.1 nm or 0.1 nrad, so that they stay bounds.

    Parameters
    ----------
    micro : ndarray, of any shape [µm or µrad]

    Returns
    -------
    ndarray, same shape, contiguous

    Examples
    --------
    >>> rounded_up(np.array([0.27501, 0.275, 0.0])).tolist()
    [0.2751, 0.275, 0.0]
    """
    tenths = np.ceil(micro * 10**DECIMALS - SLIGHT)
    return rounded(tenths / 10**DECIMALS)


Micro = Annotated[float, PlainSerializer(to_tenth_nm, return_type=float, when_used="json")]
"""A computed number of µm, µrad, µm/m or µrad/m."""

Digits = Annotated[float, PlainSerializer(to_digits, return_type=float, when_used="json")]
"""A computed number that others may divide by, or of a unit that its name says."""


def listed(
    axes: int,
    number: Any = float,
    write: Callable[[NDArray[np.float64]], NDArray[np.float64]] | None = None,
) -> GetPydanticSchema:
    """Publish an array as lists in lists of numbers, null for those that are not finite.

    Parameters
    ----------
    axes
        How many it has.
    number
        What the document says of each number, such as that null may stand for it.
    write
        How numbers that are not whole are rounded where JSON is written; to 0.1 nm where it is
        left out.
    """
    lists: Any = number
    for _ in range(axes):
        lists = list[lists]
    return GetPydanticSchema(
        lambda _, handler: core_schema.any_schema(
            serialization=core_schema.plain_serializer_function_ser_schema(
                partial(_as_lists, write or rounded),
                return_schema=handler.generate_schema(lists),
                when_used="json",
            )
        )
    )


def _as_lists(
    write: Callable[[NDArray[np.float64]], NDArray[np.float64]], array: NDArray[Any]
) -> list[Any]:
    written: NDArray[Any] = write(array) if array.dtype.kind == "f" else array
    finite = np.isfinite(written)
    if not finite.all():
        written = written.astype(object)
        written[~finite] = None
    lists: list[Any] = written.tolist()
    return lists


Parameters = Annotated[
    Mapping[str, float],
    PlainSerializer(to_digits_in, return_type=dict[str, float], when_used="json"),
]
"""Computed numbers by name with unit."""
