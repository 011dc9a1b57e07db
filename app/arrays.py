"""Arrays of double precision that nobody changes."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray: TypeAlias = NDArray[np.float64]


def frozen(values: ArrayLike) -> FloatArray:
    """Copy into a read-only array of at least one dimension.

    >>> frozen([1, 2]).flags.writeable
    False
    """
    array = np.array(values, dtype=np.float64, ndmin=1)
    array.flags.writeable = False
    return array
