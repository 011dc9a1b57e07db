"""Computed numbers are written to 0.1 nm and 0.1 nrad: below any measurement, and short.

Stored values (maps, readings, verifications) are written as they came, and npy and Arrow
have full precision. What others divide by, such as standard errors, is never rounded to
so many decimals, which could make it 0, but to so many digits.
"""

from __future__ import annotations

from typing import Annotated, Final

import numpy as np
from pydantic import PlainSerializer

from app.api.schemas.base import Number
from app.arrays import FloatArray

DECIMALS: Final = 4
"""Of µm, µrad, µm/m and µrad/m."""

DIGITS: Final = 9
"""Of ratios, standard deviations and figures of different units."""


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


def rounded(micro: FloatArray) -> FloatArray:
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


def rounded_up(micro: FloatArray) -> FloatArray:
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
    # A rounding error above a tenth of a nanometre is no reason for the next one.
    tenths = np.ceil(micro * 10**DECIMALS - 1e-6)
    return rounded(tenths / 10**DECIMALS)


Micro = Annotated[Number, PlainSerializer(to_tenth_nm, return_type=float, when_used="json")]
"""A computed number of µm, µrad, µm/m or µrad/m."""

Digits = Annotated[Number, PlainSerializer(to_digits, return_type=float, when_used="json")]
"""A computed number that others may divide by, or of a unit that its name says."""
