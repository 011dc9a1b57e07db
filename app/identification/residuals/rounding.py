"""What the rounding of an instrument adds to the repeatability that a verification states.

JCGM 100:2008 (GUM), F.2.2.1: a digital indication of step δ has a standard uncertainty of δ/√12.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from app.arrays import FloatArray

FEWEST_STEPS: Final = 5
"""So many distances of neighbouring values, at least, must be whole steps."""

UNEVEN: Final = 0.01
"""Distances are whole steps within this share of one: values are written to 0.1 nm."""

WRITTEN: Final = 4
"""Decimals to which values count as the same."""


def rounding(measured: FloatArray) -> float:
    """Find the standard deviation that one instrument's values have of being read in whole steps.

    Parameters
    ----------
    measured : ndarray, shape (n,)
        As measured, not yet compared with anything.

    Returns
    -------
    float
        In the values' unit; 0 where they show no step.

    Examples
    --------
    >>> round(rounding(np.array([-4.0, -2.0, 0.0, 0.0, 2.0, 6.0, 10.0])), 4)
    0.5774
    """
    distinct = np.unique(np.round(measured, WRITTEN))
    apart = np.diff(distinct)
    if len(apart) < FEWEST_STEPS:
        return 0.0
    steps = apart / apart.min()
    if np.abs(steps - np.round(steps)).max() > UNEVEN:
        return 0.0
    return float(apart.min() / np.sqrt(12.0))
