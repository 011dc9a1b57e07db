"""What an effect does everywhere alike, where zeros of set-ups hide it.

The zero of such a set-up takes from the effect its mean in that set-up. Left of it is the little
that changes within one set-up: least squares make of it a size that may be many times what the
effect does along the axis, and of which a standard error says that nobody knows it. Corrected by
it, a machine may be worse than by its maps. So it is expected to be about as large as what was
seen, by a normal distribution about zero: then what adopting it may cost is less than what the
rest of the effect gains, and where the set-ups determine it, nothing changes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

import numpy as np

from app.arrays import BoolArray, FloatArray
from app.search.candidate import Part
from app.search.priors import HIDDEN_SIZE
from app.search.rows import Datum, Rows

HARDLY: Final = 0.5
"""What is hidden is hardly known by a standard error above this share of what is seen."""


class Shrunk(NamedTuple):
    """Amplitudes with what is expected of their hidden part.

    Parameters
    ----------
    amplitudes, covariance : ndarray, shape (k,) and (k, k)
        Their mean and covariance.
    is_hardly_known
        Whether the set-ups tell little of the hidden part.
    """

    amplitudes: FloatArray
    covariance: FloatArray
    is_hardly_known: bool = False


def with_expected(
    amplitudes: FloatArray,
    covariance: FloatArray,
    parts: Iterable[Part],
    rows: Rows,
    use: BoolArray,
    noise: Mapping[int, float],
) -> Shrunk:
    """Weigh what was estimated against what is expected of its hidden part.

    Parameters
    ----------
    amplitudes, covariance : ndarray, shape (k,) and (k, k)
        As least squares give them. One alone has no part of its own that is hidden: what it does
        along the axis says what it does everywhere alike.
    parts
        What one unit of each amplitude does.
    use : ndarray of bool, shape (n,)
        Which rows took part.
    """
    hidden, seen = _squares(amplitudes.size, parts, rows, use, noise)
    size = float(amplitudes @ seen @ amplitudes)
    if amplitudes.size < 2 or size <= 0.0 or not hidden.any():
        return Shrunk(amplitudes, covariance)
    precision = hidden / (HIDDEN_SIZE**2 * size)
    # (C⁻¹ + P)⁻¹ C⁻¹, where C may be singular.
    weight = np.linalg.inv(np.eye(amplitudes.size) + covariance @ precision)
    influence = weight @ covariance
    unknown = float(np.trace(influence @ hidden))
    return Shrunk(
        weight @ amplitudes,
        (influence + influence.T) / 2.0,
        is_hardly_known=unknown > HARDLY**2 * size,
    )


def _squares(
    count: int, parts: Iterable[Part], rows: Rows, use: BoolArray, noise: Mapping[int, float]
) -> tuple[FloatArray, FloatArray]:
    """Add up the squares of what zeros take from each set-up, and of what they leave.

    Returns
    -------
    hidden, seen : ndarray, shape (k, k)
        As forms of the amplitudes, in squares of each channel's noise.
    """
    hidden, seen = np.zeros((count, count)), np.zeros((count, count))
    for part in parts:
        used = use[part.rows]
        columns = part.columns[used] / noise[part.channel]
        visits = rows.visit[part.rows][used]
        for visit in np.unique(visits).tolist():
            here = columns[visits == visit]
            datum = rows.datum.get((visit, part.channel), Datum.ABSOLUTE)
            mean = here.mean(axis=0) * (datum is not Datum.ABSOLUTE)
            hidden += len(here) * np.outer(mean, mean)
            seen += (here - mean).T @ (here - mean)
    return hidden, seen
