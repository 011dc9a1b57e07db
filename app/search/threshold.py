"""One threshold for everything that was tried: the largest statistic under pure noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import gammaincc, gammaln

from app.arrays import FloatArray
from app.search.scan import Scan

BARTLETT: Final = (0.4, 1.3)
"""A correction beyond this says more about the draws than about the statistic."""

EULER: Final = 0.5772156649015329


@dataclass(frozen=True, eq=False)
class Threshold:
    """What a candidate's surprise must exceed.

    Parameters
    ----------
    surprise
        −log10 p above which one entry of all counts as found.
    location, scale
        Of the Gumbel distribution of the largest surprise under noise.
    bartlett : ndarray, shape (entries,)
        Factor that brings each statistic to its χ² mean.
    """

    surprise: float
    location: float
    scale: float
    bartlett: FloatArray

    def of(self, found: Scan) -> FloatArray:
        """Give the surprise of every entry, −log10 p.

        Parameters
        ----------
        found
            A scan.

        Returns
        -------
        ndarray, shape (entries,)
        """
        return surprise(found.ratio * self.bartlett, found.rank)

    def global_p(self, largest: float) -> float:
        """Give the probability that noise alone surprises as much somewhere.

        Parameters
        ----------
        largest
            The largest surprise.
        """
        return float(-np.expm1(-np.exp(-(largest - self.location) / self.scale)))


def threshold(found: Scan, groups: np.ndarray, false_alarm: float) -> Threshold:
    """Take the threshold from draws of noise, with a smoothed tail.

    The largest of many surprises is close to a Gumbel variable: its two moments are
    estimated well from few draws, an empirical 99th percentile is not.

    Parameters
    ----------
    found
        A scan with draws.
    groups : ndarray, shape (entries,)
        Entries of one candidate share their Bartlett factor: it is then less uncertain.
    false_alarm
        Accepted probability that anything is found in noise.

    Returns
    -------
    Threshold

    References
    ----------
    P. Westfall, S. Young, Resampling-based multiple testing (1993): max-T.
    """
    bartlett = _bartlett(found, groups)
    draws = surprise(found.noise * bartlett[:, None], found.rank[:, None]).max(axis=0, initial=0.0)
    scale = max(float(draws.std(ddof=1)) * np.sqrt(6.0) / np.pi, 1e-3)
    location = float(draws.mean()) - EULER * scale
    limit = location - scale * np.log(-np.log1p(-false_alarm))
    return Threshold(float(limit), location, scale, bartlett)


def surprise(ratio: FloatArray, freedom: FloatArray) -> FloatArray:
    """Give −log10 of the probability that χ² exceeds a value, far into the tail.

    Parameters
    ----------
    ratio : ndarray, shape (...)
    freedom : ndarray, shape (...)
        Degrees of freedom; 0: no surprise.

    Returns
    -------
    ndarray, shape (...)

    Examples
    --------
    >>> [round(float(v), 3) for v in surprise(np.array([3.841459, 4000.0]), np.array([1.0, 2.0]))]
    [1.301, 868.589]
    """
    a = np.maximum(freedom, 1.0) / 2.0
    x = np.maximum(ratio, 0.0) / 2.0
    with np.errstate(divide="ignore"):
        near = np.log(np.maximum(gammaincc(a, x), 1e-300))
    far = (
        -x
        + (a - 1.0) * np.log(np.maximum(x, 1.0))
        - gammaln(a)
        + np.log1p((a - 1) / np.maximum(x, 1))
    )
    found = -np.where(x < 300.0, near, far) / np.log(10.0)
    return np.where(freedom > 0, np.maximum(found, 0.0), 0.0)


def upper_tail(ratio: float, freedom: float) -> float:
    """Give the probability that χ² exceeds a value.

    >>> round(upper_tail(3.841459, 1), 4)
    0.05
    """
    return float(gammaincc(freedom / 2.0, max(ratio, 0.0) / 2.0))


def _bartlett(found: Scan, groups: np.ndarray) -> FloatArray:
    count = np.maximum(np.bincount(groups, weights=(found.rank > 0) * 1.0), 1.0)
    relative = found.noise.mean(axis=1) / np.maximum(found.rank, 1.0)
    mean = np.bincount(groups, weights=relative * (found.rank > 0)) / count
    return np.asarray(np.clip(1.0 / np.maximum(mean, 1e-3), *BARTLETT)[groups])
