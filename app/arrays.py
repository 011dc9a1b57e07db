"""Kinds of arrays, arrays of double precision that nobody changes, and how BLAS is to run."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

if TYPE_CHECKING:
    from scipy.sparse import csr_array

FloatArray: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.intp]
"""Counts, and numbers of places, rows, visits, channels."""
SparseArray: TypeAlias = "csr_array[np.float64]"
"""A matrix by rows, of which only what is not zero is kept."""

NORMAL: Final = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""


def frozen(values: ArrayLike) -> FloatArray:
    """Copy into a read-only array of at least one dimension.

    >>> frozen([1, 2]).flags.writeable
    False
    """
    array = np.array(values, dtype=np.float64, ndmin=1)
    array.flags.writeable = False
    return array


def to_significant(values: FloatArray, digits: int) -> tuple[float, ...]:
    """Round each value to so many significant digits.

    >>> to_significant(np.array([1234.5, 0.00123456]), 3)
    (1230.0, 0.00123)
    """
    return tuple(float(f"{value:.{digits}g}") for value in values.tolist())


def rms(values: FloatArray) -> float:
    """Give the root mean square of all values, of any shape.

    >>> rms(np.array([1.0, 7.0]))
    5.0
    """
    return float(np.sqrt(np.mean(values**2)))


def robust_sd(deviations: FloatArray) -> float:
    """Give the standard deviation of a normal distribution with the values' median size.

    What lies far off does not count (F. Hampel, J. Am. Stat. Assoc. 69 (1974) 383).

    >>> round(robust_sd(np.array([-1.0, 1.0, 0.5, 400.0])), 4)
    1.4826
    """
    return NORMAL * float(np.median(np.abs(deviations)))


def rms_length(vectors: FloatArray) -> float:
    """Give the root mean square of vectors' lengths, shape (n, d).

    >>> rms_length(np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 0.0]]))
    3.5355339059327378
    """
    return float(np.sqrt((vectors**2).sum(axis=-1).mean()))


def largest_length(vectors: FloatArray) -> float:
    """Give the largest of vectors' lengths, shape (n, d).

    >>> largest_length(np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 0.0]]))
    5.0
    """
    return float(np.linalg.norm(vectors, axis=-1).max())


def one_blas_thread() -> AbstractContextManager[Any]:
    """Keep BLAS to one thread: of small matrices, threads that wait for each other make more work.

    For the whole process, until the context is left.
    """
    limits: AbstractContextManager[Any] = threadpool_limits(limits=1, user_api="blas")
    return limits
