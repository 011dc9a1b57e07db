"""Figures of residuals on held-out visits, with intervals over visits.

A. Davison, D. Hinkley, Bootstrap Methods and their Application (1997): resampling of clusters.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from app.arrays import FloatArray, IntArray, rms
from app.search.findings import Figure

RESAMPLED: Final = 1000
"""Campaigns put together from the same visits for an interval."""


def figure(residuals: FloatArray, visit: IntArray, seed: int) -> Figure:
    """Sum up residuals, with a 95 % interval of the root mean square over visits.

    Whole visits are drawn again, never single rows: rows of one visit share its scatter.

    Parameters
    ----------
    residuals : ndarray, shape (n,)
        In any unit.
    visit : ndarray, shape (n,)

    Examples
    --------
    >>> f = figure(np.array([3.0, -3.0, 3.0, -3.0]), np.array([0, 0, 1, 1]), 0)
    >>> f.rms, f.low, f.high
    (3.0, 3.0, 3.0)
    """
    _, group = np.unique(visit, return_inverse=True)
    squares = np.bincount(group, weights=residuals**2)
    counts = np.bincount(group)
    random = np.random.default_rng(seed)
    picks = random.multinomial(len(counts), np.full(len(counts), 1 / len(counts)), RESAMPLED)
    drawn = np.sqrt((picks @ squares) / (picks @ counts))
    low, high = np.quantile(drawn, [0.025, 0.975])
    return Figure(rms(residuals), float(low), float(high))
