"""Kinds of arrays, arrays of double precision that nobody changes, and how BLAS is to run."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

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


def one_blas_thread() -> AbstractContextManager[Any]:
    """Keep BLAS to one thread: of small matrices, threads that wait for each other make more work.

    For the whole process, until the context is left.
    """
    limits: AbstractContextManager[Any] = threadpool_limits(limits=1, user_api="blas")
    return limits
