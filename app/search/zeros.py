"""Zeros of an instrument that nobody knows, taken off of residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.arrays import FloatArray, IntArray
from app.search.rows import Datum, Rows


@dataclass(frozen=True, slots=True, eq=False)
class UnknownZero:
    """Rows that share a zero of the instrument that is not the model's.

    Parameters
    ----------
    rows : ndarray, shape (m,)
        In order of time.
    is_first
        Whether the instrument read zero at the first of them.
    """

    rows: IntArray
    is_first: bool


def unknown_zeros(rows: Rows) -> list[UnknownZero]:
    """List the rows that share each unknown zero of an instrument."""
    zeros = []
    for (visit, channel), datum in rows.datum.items():
        of_zero = np.flatnonzero((rows.visit == visit) & (rows.channel == channel))
        if of_zero.size and datum is not Datum.ABSOLUTE:
            ordered = of_zero[np.argsort(rows.minutes[of_zero], kind="stable")]
            zeros.append(UnknownZero(ordered, datum is Datum.FIRST))
    return zeros


def without_zeros(zeros: Sequence[UnknownZero], values: FloatArray) -> FloatArray:
    """Take unknown zeros of an instrument off, as a user of the machine meets what is left.

    Of an instrument that was zeroed at its first observation that observation's residual, of
    one whose zero nobody knows the mean.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Residuals; NaN takes no part.

    Returns
    -------
    ndarray, shape (n,)

    Examples
    --------
    >>> values, shared = np.array([3.0, 5.0, 7.0]), np.array([0, 1])
    >>> without_zeros([UnknownZero(shared, False)], values).tolist()
    [-1.0, 1.0, 7.0]
    >>> without_zeros([UnknownZero(shared, True)], values).tolist()
    [0.0, 2.0, 7.0]
    """
    shifted = values.copy()
    for zero in zeros:
        present = zero.rows[~np.isnan(values[zero.rows])]
        if present.size:
            shifted[present] -= values[present[0]] if zero.is_first else values[present].mean()
    return shifted
