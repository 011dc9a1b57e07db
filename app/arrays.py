"""Kinds of arrays, and arrays of double precision that nobody changes."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.intp]
"""Counts, and numbers of places, rows, visits, channels."""


def frozen(values: ArrayLike) -> FloatArray:
    """Copy into a read-only array of at least one dimension.

    >>> frozen([1, 2]).flags.writeable
    False
    """
    array = np.array(values, dtype=np.float64, ndmin=1)
    array.flags.writeable = False
    return array
